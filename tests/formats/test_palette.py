"""Codebooks and palettes by hand, and notes in files of other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.file_notes import npz_notes, ply_notes
from tinysplat_runtime.formats.palette import codebook, nearest, palette


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
