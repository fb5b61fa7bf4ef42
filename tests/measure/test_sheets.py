"""Sheets of two results side by side: which windows are paired, what stands above each picture, and the pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from scenes import make_cameras, make_smooth_gaussians

from tinysplat.measure.metrics import psnr, ssim
from tinysplat.measure.show import sheets
from tinysplat.measure.show.sheets import Pair, Sheet, error_map, gaussian_sheet, matching, read_results, write_sheet
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.scene.images import read_image, write_png

RNG = np.random.default_rng(0)
A, B, PHOTO = (RNG.uniform(0.2, 0.8, (12, 16, 3)) for _ in range(3))


def test_an_error_is_the_mean_over_a_pixels_colours() -> None:
    found = error_map(np.float32([[[0.5, 0.5, 0.5]]]), np.array([[[0.2, 0.9, 0.5]]]))
    np.testing.assert_allclose(found, [[0.7 / 3]])


def test_scores_are_of_b_against_a_and_of_both_against_the_photo() -> None:
    assert Pair("view 0", A, B).scores() == {"view": "view 0", "psnr_b_to_a": psnr(B, A), "ssim_b_to_a": ssim(B, A)}
    found = Pair("v", A, B, PHOTO).scores()
    assert found["psnr_a_to_photo"] == psnr(A, PHOTO) and found["ssim_b_to_photo"] == ssim(B, PHOTO)
    assert found["psnr_b_to_photo"] == psnr(B, PHOTO) and found["ssim_a_to_photo"] == ssim(A, PHOTO) and len(found) == 7


def test_tiles_are_pictures_and_maps_with_their_decibels() -> None:
    pictures, maps = Pair("v", A, B).tiles(("A", "B"))
    assert [name for name, _ in pictures] == ["A", "B"] and pictures[0][1] is A and pictures[1][1] is B
    assert [name for name, _ in maps] == [f"|B − A|  {psnr(B, A):.2f} dB"]
    np.testing.assert_array_equal(maps[0][1], np.abs(B - A).mean(axis=-1))
    pictures, maps = Pair("v", A, PHOTO, PHOTO).tiles(("x", "y"))
    assert [name for name, _ in pictures] == ["photo", "x", "y"]
    assert [name for name, _ in maps] == [f"|A − photo|  {psnr(A, PHOTO):.2f} dB", "|B − photo|  identical"]
    np.testing.assert_array_equal(maps[0][1], np.abs(A - PHOTO).mean(axis=-1))


def test_gaussians_are_seen_from_their_views_and_midway_between_neighbours() -> None:
    pair = tuple(make_smooth_gaussians(3, 12, 16, seed=seed) for seed in (0, 1))
    cameras = make_cameras(3, 12, 16)
    sheet = gaussian_sheet(pair, ("one", "two"), cameras, (24, 32))
    assert (sheet.name, sheet.title) == ("comparison", "A: one   B: two")
    labels = ["view 0", "between 0 and 1", "view 1", "between 1 and 2", "view 2"]
    assert [row.label for row in sheet.rows] == labels
    for row, camera in ((sheet.rows[0], cameras[0]), (sheet.rows[4], cameras[2])):
        for picture, scene in ((row.a, pair[0]), (row.b, pair[1])):
            np.testing.assert_allclose(picture, Renderer(scene).render(camera, (24, 32)), atol=1e-6)


def record(**changes: Any) -> dict[str, Any]:
    return {
        "scene": "fox", "kind": "near", "context": [0, 4], "targets": [1], "height": 12, "width": 16, "model": "edge",
        "profile": "paper", "qp": 0.0, "bytes": 4321, "views": 2, "pictures": "p", **changes,
    }  # fmt: skip


def test_windows_are_paired_by_how_they_were_coded_or_as_the_only_one() -> None:
    a, b = record(), record(profile="fast", qp=3.0)
    assert list(matching([a], [b])) == [(a, b)]
    assert list(matching([a, b], [b])) == [(b, b)]
    assert list(matching([a], [b, a])) == [(a, a)]
    assert list(matching([a, b], [b, a])) == [(a, a), (b, b)]
    for name, value in (
        ("scene", "x"),
        ("kind", "far"),
        ("context", [0, 5]),
        ("targets", [2]),
        ("height", 9),
        ("width", 9),
    ):
        assert list(matching([a], [record(**{name: value})])) == []
    for name, value in (("model", "x"), ("profile", "max"), ("qp", 1.0)):
        assert list(matching([a, record(**{name: value})], [b, a])) == [(a, a)]


def test_results_are_entries_with_bytes(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text(json.dumps({"scenes": [record(), record(bytes=None)]}))
    assert read_results(tmp_path) == [record()]
    for text in ("{}", "[]", "no", '{"scenes": [{"bytes": 1}]}', '{"scenes": 3}'):
        path.write_text(text)
        with pytest.raises(InputError, match=r"results\.json: not results of an evaluation \("):
            read_results(tmp_path)


def folder_of(folder: Path, entries: list[dict[str, Any]], level: int, photo: bool) -> Path:
    """An evaluation's folder whose decoded pictures are of one level."""
    place = folder / "pictures" / "p"
    place.mkdir(parents=True)
    for n in range(2):
        write_png(place / f"{n}_decoded.png", np.full((12, 16, 3), level + n, np.uint8))
        if photo:
            write_png(place / f"{n}_photo.png", np.full((12, 16, 3), 99 + n, np.uint8))
    (folder / "results.json").write_text(json.dumps({"scenes": entries}))
    return folder


@pytest.mark.parametrize("photo", [True, False])
def test_windows_of_two_evaluations_are_sheets(tmp_path: Path, photo: bool) -> None:
    a = folder_of(tmp_path / "a", [record(targets=[5, 8])], 100, photo)
    b = folder_of(tmp_path / "b", [record(targets=[5, 8], profile="fast", qp=2.5, bytes=999)], 50, False)
    (sheet,) = sheets.result_sheets(a, b)
    assert sheet.name == "fox-near-0_4-paper-0"
    assert sheet.title == "fox, near, 2 views (0,4)\nA: edge, paper at Q_g 0, 4 KB   B: edge, fast at Q_g 2.5, 1 KB"
    assert [row.label for row in sheet.rows] == ["frame 5", "frame 8"]
    for n, row in enumerate(sheet.rows):
        np.testing.assert_allclose([row.a[0, 0, 0], row.b[0, 0, 0]], [(100 + n) / 255, (50 + n) / 255], rtol=1e-6)
        assert (row.photo is None) is not photo
        assert row.photo is None or row.photo[3, 3, 1] == pytest.approx((99 + n) / 255)


def test_folders_without_pictures_or_common_windows_are_refused(tmp_path: Path) -> None:
    a = folder_of(tmp_path / "a", [record()], 1, True)
    none = folder_of(tmp_path / "b", [record(pictures="")], 1, True)
    other = folder_of(tmp_path / "c", [record(scene="x")], 1, True)
    for pair, said in (((a, none), f"{none}: results without pictures"), ((a, other), f"{other}: no window in common")):
        with pytest.raises(InputError) as caught:
            sheets.result_sheets(*pair)
        assert str(caught.value).startswith(said)


def test_two_pictures_must_be_of_one_size(tmp_path: Path) -> None:
    write_png(tmp_path / "a.png", np.full((12, 16, 3), 51, np.uint8))
    write_png(tmp_path / "b.png", np.full((12, 16, 3), 102, np.uint8))
    write_png(tmp_path / "c.png", np.zeros((12, 15, 3), np.uint8))
    sheet = sheets.picture_sheet(tmp_path / "a.png", tmp_path / "b.png")
    assert (sheet.name, sheet.title, sheet.rows[0].label) == ("comparison", "A: a.png   B: b.png", "a")
    np.testing.assert_allclose([sheet.rows[0].a.max(), sheet.rows[0].b.max()], [0.2, 0.4])
    with pytest.raises(InputError, match=r"c\.png: 15x12 pixels, but .*a\.png has 16x12"):
        sheets.picture_sheet(tmp_path / "a.png", tmp_path / "c.png")


@pytest.mark.parametrize(("rows", "names"), [(8, ["a_b-c.1.png"]), (9, ["a_b-c.1-1.png", "a_b-c.1-2.png"])])
def test_eight_rows_make_a_sheet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: int, names: list[str]) -> None:
    drawn = []
    monkeypatch.setattr(sheets, "_draw", lambda path, title, part: drawn.append((path.name, title, len(part))))
    paths = write_sheet(tmp_path, Sheet("a b-c.1", "title", tuple(Pair(str(n), A, B) for n in range(rows))))
    assert [path.name for path in paths] == names == [name for name, *_ in drawn]
    assert [count for *_, count in drawn] == ([8] if rows == 8 else [8, 1])


def test_maps_of_a_sheet_share_a_scale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: list[Figure] = []
    save = Figure.savefig
    monkeypatch.setattr(
        Figure, "savefig", lambda figure, *given, **options: (figures.append(figure), save(figure, *given, **options))
    )
    rows = [Pair("first", A, B), Pair("second", A * 1.5, A)]
    (path,) = write_sheet(tmp_path, Sheet("s", "The title", tuple(rows)))
    (figure,) = figures
    assert figure.get_suptitle() == "The title" and figure.dpi == 72
    assert tuple(figure.get_size_inches()) == pytest.approx((3 * 2.4 + 0.6, 2 * (2.4 * 12 / 16 + 0.3) + 0.5))
    assert read_image(path).shape[:2] == (334, 561) or read_image(path).ndim == 3
    tiles = figure.axes[:6]
    assert [axes.get_title() for axes in tiles[:3]] == ["A", "B", f"|B − A|  {psnr(B, A):.2f} dB"]
    assert [axes.get_ylabel() for axes in tiles] == ["first", "", "", "second", "", ""]
    maps = [error_map(B, A), error_map(A, A * 1.5)]
    for axes, wanted in zip(tiles[2::3], maps, strict=True):
        (image,) = axes.get_images()
        np.testing.assert_allclose(image.get_array(), wanted)
        assert image.get_clim() == pytest.approx((0, np.percentile(maps, 99.5))) and image.get_cmap().name == "magma"
    (second,) = tiles[3].get_images()
    np.testing.assert_allclose(second.get_array(), np.clip(A * 1.5, 0, 1))
    assert all(len(axes.get_xticks()) == len(axes.get_yticks()) == 0 for axes in tiles)


def test_equal_pictures_have_a_scale_of_one_level_and_large_ones_their_own_pixels(tmp_path, monkeypatch) -> None:
    figures: list[Figure] = []
    monkeypatch.setattr(
        Figure, "savefig", lambda figure, path, **_: (figures.append(figure), Path(path).write_bytes(b""))
    )
    large = np.zeros((8, 480, 3))
    write_sheet(tmp_path, Sheet("s", "", (Pair("v", large, large),)))
    (image,) = figures[0].axes[2].get_images()
    assert image.get_clim() == (0, pytest.approx(1 / 255)) and figures[0].dpi == 200
