"""Photos are placed where they were taken, alike in every run, and what contradicts its place is named."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest
from numpy.typing import NDArray
from poses.walls import FOCAL, HEIGHT, WIDTH, photograph, textured, write_photos_of_walls

from tinysplat.poses.copies import copies
from tinysplat.poses.judging import Placement, contradicted, uncertainty
from tinysplat.poses.model import coloured_points
from tinysplat.poses.pairs import pairs_of_many, shared_features
from tinysplat.poses.placing import MASKS, NonePlacedError, place
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.images import read_image
from tinysplat_runtime.scene.pictures import write_png


@pytest.fixture(scope="module")
def placed(tmp_path_factory: pytest.TempPathFactory) -> tuple[NDArray, list[Placement], Path]:
    """True centres (5, 3), what two runs on different numbers of threads found, and the folder of the first."""
    folder = tmp_path_factory.mktemp("placing")
    truth = np.stack([camera.centre for camera in write_photos_of_walls(folder / "photos", 5)])
    found = []
    for threads in (1, 2):
        (work := folder / str(threads)).mkdir()
        found.append(place(folder / "photos", [f"{i}.png" for i in range(5)], work, threads))
    return truth, found, folder / "1"


def centres(placement: Placement) -> NDArray:
    images = {image.name: image for image in placement.model.images.values()}
    return np.stack([images[f"{i}.png"].projection_center() for i in range(5)])


def test_photos_lie_where_they_were_taken(placed: tuple[NDArray, list[Placement], Path]) -> None:
    truth, (placement, again), _ = placed
    found = centres(placement)
    unit = np.linalg.norm(truth[4] - truth[0]) / np.linalg.norm(found[4] - found[0])
    steps = np.linalg.norm(np.diff(truth, axis=0), axis=1)
    np.testing.assert_allclose(unit * np.linalg.norm(np.diff(found, axis=0), axis=1), steps, rtol=0.05)
    np.testing.assert_array_equal(found, centres(again))
    assert placement.wrong == frozenset() and placement.others == () and placement.uncertain == ()
    points, colours, errors = coloured_points(placement.model)
    assert len(points) == len(colours) == len(errors) > 50 and np.isfinite(errors).all()


def test_what_masks_leave_out_tells_no_places(tmp_path: Path) -> None:
    """What stays in place on all photos, as a photographer's shadow does, says that the camera did not move."""
    truth = np.stack([camera.centre for camera in write_photos_of_walls(tmp_path / "photos", 5)])
    window = np.s_[50:190, 70:250]
    (tmp_path / MASKS).mkdir()
    for path in sorted((tmp_path / "photos").iterdir()):
        photo = read_image(path).copy()
        photo[window] = textured(7)[window].astype(np.uint8)
        write_png(path, photo)
        mask = np.full(photo.shape[:2], 255, np.uint8)
        mask[window] = 0
        write_png(tmp_path / MASKS / f"{path.name}.png", mask)
    found = centres(place(tmp_path / "photos", [f"{i}.png" for i in range(5)], tmp_path, 1))
    unit = np.linalg.norm(truth[4] - truth[0]) / np.linalg.norm(found[4] - found[0])
    steps = np.linalg.norm(np.diff(truth, axis=0), axis=1)
    np.testing.assert_allclose(unit * np.linalg.norm(np.diff(found, axis=0), axis=1), steps, rtol=0.05)


def test_a_photo_whose_matches_contradict_its_place_is_named(placed: tuple[NDArray, list[Placement], Path]) -> None:
    _, (placement, _), work = placed
    model = pycolmap.Reconstruction(placement.model)
    image = next(image for image in model.images.values() if image.name == "3.png")
    pose = image.cam_from_world()
    image.frame.rig_from_world = pycolmap.Rigid3d(pose.rotation, pose.translation + np.array([0.0, 1.5, 0.0]))
    assert contradicted(model, work / "database.db") == {"3.png"}


def test_places_of_a_camera_that_hardly_moved_are_uncertain(tmp_path: Path) -> None:
    write_photos_of_walls(tmp_path / "photos", 4, spacing=0.005)
    (tmp_path / "work").mkdir()
    assert place(tmp_path / "photos", [f"{i}.png" for i in range(4)], tmp_path / "work", 1).uncertain


def test_places_of_which_one_is_fixed_by_nothing_are_uncertain(placed: tuple[NDArray, list[Placement], Path]) -> None:
    model = pycolmap.Reconstruction(placed[1][0].model)
    image = next(image for image in model.images.values() if image.name == "3.png")
    for index in [i for i, point in enumerate(image.points2D) if point.has_point3D()]:
        model.delete_observation(image.image_id, index)
    assert set(uncertainty(model).values()) == {np.inf}


@pytest.mark.parametrize(
    ("turns", "zooms", "walks", "is_turn"),
    [(5, 1.0, 0.0, True), (0, 1.12, 0.0, True), (3, 1.08, 0.0, True), (0, 1.0, 0.3, False), (-3, 1.0, 0.3, False)],
    ids=["turns", "zooms", "both", "walks past a wall", "walks around it"],
)
def test_cameras_that_only_turn_or_zoom_are_told_from_those_that_walk_past_one_wall(
    tmp_path: Path, turns: float, zooms: float, walks: float, is_turn: bool
) -> None:
    (tmp_path / "photos").mkdir()
    for i in range(8):
        f, angle = FOCAL * zooms**i, np.radians(turns * (i - 3.5))
        c2w = np.eye(4)
        c2w[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        c2w[:2, 3] = walks * (i - 3.5), 0.1 * walks * (i % 3)
        camera = Camera([[f, 0, WIDTH / 2], [0, f, HEIGHT / 2], [0, 0, 1]], c2w, WIDTH, HEIGHT)
        write_png(tmp_path / f"photos/{i}.png", photograph(camera, [(6.0, 8.0, textured(0))]))
    try:
        placement = place(tmp_path / "photos", [f"{i}.png" for i in range(8)], tmp_path, 1)
        assert placement.only_turns is is_turn
    except NonePlacedError:
        assert is_turn


def test_copies_are_found_by_their_bytes(tmp_path: Path) -> None:
    for name, value in (("a.png", 1), ("b.png", 2), ("c.png", 1)):
        write_png(tmp_path / name, np.full((8, 8, 3), value, np.uint8))
    assert copies(tmp_path, ["a.png", "b.png", "c.png"]) == {"c.png": "a.png"}


def test_of_many_photos_neighbours_and_those_that_share_features_are_paired(
    placed: tuple[NDArray, list[Placement], Path],
) -> None:
    shared = shared_features([f"{i}.png" for i in range(5)], placed[2] / "database.db")
    np.testing.assert_array_equal(shared, shared.T)
    assert not np.diag(shared).any() and (shared[0, 1:] > 0).all() and shared[0, 4] == shared[0, 1:].min()

    walk = np.zeros((120, 120), np.int64)  # the second half comes back to where the first was
    for i in range(60):
        walk[i, i + 60] = walk[i + 60, i] = 9
    pairs = set(pairs_of_many(walk, 2))
    assert all((i, i + 1) in pairs for i in range(119)) and all((i, i + 60) in pairs for i in range(60))
    assert all(i < j for i, j in pairs) and (0, 30) not in pairs
