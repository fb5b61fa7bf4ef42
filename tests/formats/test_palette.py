"""Codebooks and palettes by hand, notes in files of other tools, and names and levels of SOG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats import sog
from tinysplat_runtime.formats.file_notes import npz_notes, ply_notes
from tinysplat_runtime.formats.palette import codebook, nearest, palette
from tinysplat_runtime.formats.table import save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians


def test_the_nearest_level_is_found_and_ties_go_down() -> None:
    levels = np.array([0.0, 1.0, 4.0])
    assert nearest(np.array([-5, 0.4, 0.5, 0.6, 2.4, 2.5, 2.6, 9]), levels).tolist() == [0, 0, 0, 1, 1, 1, 2, 2]


def test_codebooks_of_few_values_are_these_and_the_last_again() -> None:
    np.testing.assert_array_equal(codebook(np.array([3.0, 1, 3, 2]), 5), [1, 2, 3, 3, 3])
    np.testing.assert_array_equal(codebook(np.array([3.0, 1, 3, 2]), 3), [1, 2, 3])


def test_levels_are_the_means_of_what_is_nearest_to_them() -> None:
    values = np.concatenate([np.linspace(0, 1, 50), np.linspace(10, 12, 50)])
    levels = codebook(values, 4)
    for n, level in enumerate(levels):
        assert level == pytest.approx(values[nearest(values, levels) == n].mean(), abs=1e-9)
    np.testing.assert_allclose(levels, [0.245, 0.755, 10.49, 11.51], atol=0.06)


def test_a_palette_splits_the_worst_group_at_its_mean_across_its_spread() -> None:
    corners = np.array([[0, 0], [0, 1], [100, 0], [100, 1], [100, 40]], np.float32)
    two, label = palette(corners, 2)
    assert label.tolist() in ([0, 0, 1, 1, 1], [1, 1, 0, 0, 0])
    np.testing.assert_allclose(two[label[0]], [0, 0.5])
    np.testing.assert_allclose(two[label[2]], [100, 41 / 3], rtol=1e-6)
    three, label = palette(corners, 3)  # of the two, the one with 40 in it
    assert len({*label[:2].tolist()}) == 1 and label[2] == label[3] != label[4]
    np.testing.assert_allclose(three[label], [[0, 0.5], [0, 0.5], [100, 0.5], [100, 0.5], [100, 40]], rtol=1e-6)
    five, label = palette(corners, 9)
    assert len(five) == 5 and five.dtype == np.float32
    np.testing.assert_array_equal(five[label], corners)


def test_a_palette_s_groups_are_as_many_as_asked_for() -> None:
    vectors = np.random.default_rng(1).normal(size=(300, 3))
    for size in (1, 2, 3, 7, 64):
        found, label = palette(vectors, size)
        assert len(found) == size == label.max() + 1
        for n in range(size):
            np.testing.assert_allclose(found[n], vectors[label == n].mean(axis=0), atol=1e-6)


@pytest.mark.parametrize(
    ("comments", "notes"),
    [
        ("comment unit: a\\u00e9\ncomment licence:CC0\r\ncomment other: x\n", {"unit": "aé", "licence": "CC0"}),
        ('comment unit: a"b\\\n', {"unit": 'a"b\\'}), ("comment  unit: a\n", {}),
        ("comment SplatRenderMode: mip\n", {"antialiased": "yes"}), ("comment antialiased 1\n", {"antialiased": "yes"}),
        ("comment splatrendermode: MIP\n", {"antialiased": "yes"}), ("comment antialiased 0\n", {}),
        ("comment antialiased 1\ncomment antialiased 0\n", {}), ("comment SplatRenderMode: default\n", {}),
    ],
)  # fmt: skip
def test_notes_in_comments_of_a_ply(tmp_path: Path, comments: str, notes: dict[str, str]) -> None:
    (tmp_path / "a.ply").write_bytes(f"ply\n{comments}end_header\ncomment unit: b\n".encode())
    assert ply_notes(tmp_path / "a.ply") == notes


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b'{"unit": "m", "x": 1}', {"unit": "m"}), (b"{", "notes: not JSON"), (b"[]", "notes: not a JSON object"),
        (b'"' + b"x" * 100_000 + b'"', r"notes: more than \d+ bytes"),
    ],
)  # fmt: skip
def test_notes_in_an_npz(tmp_path: Path, data: bytes, expected: Any) -> None:
    np.savez(tmp_path / "a.npz", notes=np.frombuffer(data, np.uint8))
    if isinstance(expected, dict):
        assert npz_notes(tmp_path / "a.npz") == expected
    else:
        with pytest.raises(InputError, match=expected):
            npz_notes(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", other=np.zeros(1))
    assert npz_notes(tmp_path / "b.npz") == {}


# ---- names and levels of SOG ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "is_within"),
    [
        ("a/meta.json", True), ("x" * 999, True), ("x" * 1000, False), ("", False), ("/a", False), ("a/../b", False),
        ("a\\b", False), ("a\0b", False), ("..a/b..", True),
    ],
)  # fmt: skip
def test_names_of_levels_lie_within_the_folder(name: str, is_within: bool) -> None:
    assert sog._is_within(name) is is_within


def node(**lods: Any) -> dict[str, Any]:
    return {"lods": {level: dict(zip(("file", "offset", "count"), rows, strict=True)) for level, rows in lods.items()}}


def test_of_every_node_the_finest_level_s_rows_are_taken() -> None:
    first, second = node(**{"10": (0, 1, 1), "9": (1, 5, 2)}), node(**{"0": (1, 0, 3), "1": (0, 0, 1)})
    tree = {"children": [first, {"children": [second]}]}
    rows = sog._finest(tree, 2)
    assert {*rows} == {1} and sorted((piece.start, piece.stop) for piece in rows[1]) == [(0, 3), (5, 7)]
    assert sog._finest(node(**{"0": (0, 0, 0)}), 1) == {0: [slice(0, 0)]}
    for rows_ in ((2, 0, 1), (-1, 0, 1), (0, -1, 1), (0, 0, -1)):
        with pytest.raises(InputError) as error:
            sog._finest(node(**{"0": rows_}), 2)
        assert str(error.value) == f"lod-meta.json: file {rows_[0]}, rows {rows_[1]} and {rows_[2]} more"


def test_trees_have_so_many_nodes_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sog, "_MAX_NODES", 4)
    leaf = node(**{"0": (0, 0, 1)})
    assert len(sog._finest({"children": [leaf] * 3}, 1)[0]) == 3
    with pytest.raises(InputError, match=r"lod-meta\.json: more than 4 nodes"):
        sog._finest({"children": [leaf] * 4}, 1)


def test_members_are_no_larger_than_their_pictures_may_be() -> None:
    """Eight bytes a pixel and 64 KiB."""
    asked: list[tuple[str, int]] = []

    def read(name: str, limit: int) -> bytes:
        asked.append((name, limit))
        raise InputError("too large")

    with pytest.raises(InputError):
        sog._picture(read, {"quats": {"files": ["q.webp"]}}, "quats", 0, 100)
    assert asked == [("q.webp", 800 + 65536)]


def test_a_usd_prim_reaches_three_deviations_beyond_its_means(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom, UsdVol

    means, scales = np.array([[1.0, 2, 3], [-4, 5, 6]]), np.array([[0.1, 0.5, 0.2], [1, 0.25, 0.125]])
    quats = np.tile([1.0, 0, 0, 0], (2, 1))
    g = Gaussians(means, quats, scales, np.array([0.5, 1]), np.zeros((2, 1, 3)), origin=np.array([1e6, 2e6, 0]))
    save_gaussians(tmp_path / "a.usda", g)
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    prim = UsdVol.ParticleField3DGaussianSplat(stage.GetPrimAtPath("/Scene/Gaussians"))
    np.testing.assert_allclose(prim.GetExtentAttr().Get(), [[-7, -8, -9], [2.5, -0.5, -1.5]], rtol=1e-6)
    np.testing.assert_allclose(prim.GetScalesAttr().Get(), scales, rtol=1e-6)
    place = UsdGeom.Xformable(prim).GetLocalTransformation()
    np.testing.assert_allclose(np.array(place)[3, :3], [1e6, -2e6, 0])
    assert stage.GetRootLayer().comment == "tinysplat" and stage.GetDefaultPrim().GetPath() == "/Scene"
