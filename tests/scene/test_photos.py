"""Photos found by the names that other tools gave them."""

import unicodedata
from pathlib import Path

import pytest
from scenes import make_cameras

from tinysplat_runtime.errors import InputWarning
from tinysplat_runtime.scene.intake.photos import find_photo, frames_there, own_photos, photos_in
from tinysplat_runtime.scene.scenes import Frame
from tinysplat_runtime.system.files import stays_inside


def having(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")
    return folder


@pytest.mark.parametrize(
    ("named", "there"),
    [
        ("images/a.png", "images/a.png"),
        ("./images/a", "images/a.jpg"),
        ("images\\a.png", "images/a.png"),
        ("images/a", "images/a.JPG"),
        ("images/a.jpg", "images/A.jpeg"),
        ("images/a.jpg", "images/a.png"),
        ("images/IMG 1.2", "images/IMG 1.2.PNG"),
        ("Images/sub/a.png", "images/Sub/a.png"),
        ("images/a.png", "images_4/a.png"),
        (unicodedata.normalize("NFD", "images/Gelände.png"), unicodedata.normalize("NFC", "images/Gelände.png")),
    ],
)
def test_a_photo_is_found_by_what_it_was_called(tmp_path: Path, named: str, there: str) -> None:
    assert find_photo(having(tmp_path, there), named) == tmp_path / there


def test_an_exact_name_wins(tmp_path: Path) -> None:
    names = ["images/a.PNG", "images/a.png", "images_2/a.PNG", "images/a.jpg", "images/b\\c.png", "images/b/c.png"]
    having(tmp_path, *names)
    for name in names:
        assert find_photo(tmp_path, name) == tmp_path / name


@pytest.mark.parametrize("named", ["images/b.png", "images", "other/a.png", "images/a.txt", "images/.a.png"])
def test_what_is_not_there_is_named_as_it_was(tmp_path: Path, named: str) -> None:
    assert find_photo(having(tmp_path, "images/a.png", "images/._a.png"), named) == tmp_path / named


def test_photos_of_a_folder_are_in_order_without_hidden_ones(tmp_path: Path) -> None:
    having(tmp_path, "b.JPG", "a.png", "._a.png", "notes.txt", "c.jpeg")
    assert [path.name for path in photos_in(tmp_path)] == ["a.png", "b.JPG", "c.jpeg"]
    assert photos_in(tmp_path / "nowhere") == []


def test_masks_depths_and_normals_of_others_are_nobody_s_photos(tmp_path: Path) -> None:
    beside = (
        "r_0_depth_0001.png",
        "r_0_normal_0001.png",
        "dynamic_mask_r_0.png",
        "b.jpg.mask.png",
        "b_Mask.png",
        "mask.png",
    )
    having(tmp_path, "r_0.png", "b.jpg", "unmasked.png", "depth.png", *beside)
    assert [path.name for path in own_photos(tmp_path)] == ["b.jpg", "depth.png", "r_0.png", "unmasked.png"]


def test_photos_that_are_gone_and_those_without_a_camera_are_counted(tmp_path: Path) -> None:
    having(tmp_path, *(f"{i}.png" for i in range(5)), "1.mask.png", "2.png.png", "._3.png")
    photos = [tmp_path / f"{i}.png" for i in (0, 1, 2, 8, 9)]
    photos[3].symlink_to("nowhere.png")

    def frame(i: int) -> Frame:
        return Frame(make_cameras(1, 8, 8)[0], photos[i])

    with pytest.warns(InputWarning) as caught:
        assert [frame.number for frame in frames_there(photos, "scene", frame)] == [0, 1, 2]
    gone, unused = (str(entry.message) for entry in caught)
    assert "2 of 5" in gone and "8.png, 9.png" in gone and "3 of 5" in unused
    assert [frame.number for frame in frames_there(photos[3:], "scene", frame)] == [0, 1]  # as beside a video


@pytest.mark.parametrize("name", ["../a.png", "/a.png", "a/../../b.png", "..\\a.png", "C:\\a.png", "C:a.png"])
def test_names_that_leave_their_folder_are_told_on_any_system(name: str) -> None:
    assert not stays_inside(name)
