"""Damaged and cut files: intact planes are recovered, and what is lost is named."""

from pathlib import Path

import numpy as np
import pytest
from hostile.containers import Seed, join
from scenes import make_smooth_gaussians, tells

import tinysplat_runtime as ts
from tinysplat_runtime import cli
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.gaussian.planes import CODING_ORDER, GEOMETRY, PlaneClass


@pytest.fixture(scope="module")
def seed() -> Seed:
    return Seed.of(ts.compress(make_smooth_gaussians(2, 24, 32, 1, layers=2), "balanced", -6))


def _flip(data: bytes, position: int) -> bytes:
    damaged = bytearray(data)
    damaged[position] ^= 4
    return bytes(damaged)


def _position(seed: Seed, plane_class: PlaneClass, view: int) -> int:
    """A byte in the middle of the first picture of a class, in the file."""
    place = next(p for p in seed.pict.places if p.row[:2] == (0, plane_class) and p.view == view)
    return seed.place_in_file(place.start + place.length // 2)


@pytest.mark.parametrize("view", [0, 1])
@pytest.mark.parametrize("plane_class", CODING_ORDER)
def test_one_damaged_plane_is_named_and_the_rest_is_exact(seed: Seed, plane_class: PlaneClass, view: int) -> None:
    data = _flip(seed.data, _position(seed, plane_class, view))
    with pytest.raises(FormatError):
        ts.decompress(data)
    lost, none = list[str](), list[str]()
    whole, found = ts.decompress(seed.data, lost=none), ts.decompress(data, lost=lost)
    assert (
        none == []
        and len(lost) == 1
        and all(word in lost[0] for word in ("layer 0", plane_class.label, f"view {view}"))
    )
    touched = {
        PlaneClass.DEPTH: {"means", "scales", "opacities"},
        PlaneClass.OFFSET: {"means"},
        PlaneClass.SCALE: {"scales"},
        PlaneClass.ROTATION: {"quats"},
        PlaneClass.OPACITY: {"opacities"},
        PlaneClass.COLOR: {"sh"},
    }[plane_class]
    assert set(GEOMETRY) | {PlaneClass.COLOR} == set(CODING_ORDER)
    for name in FIELDS:
        other = 1 - view
        np.testing.assert_array_equal(getattr(found, name)[other], getattr(whole, name)[other])
        if name not in touched:
            np.testing.assert_array_equal(getattr(found, name)[view], getattr(whole, name)[view])
        assert np.isfinite(getattr(found, name)).all()
    if plane_class == PlaneClass.DEPTH:
        assert not found.opacities[view].any()


def test_a_cut_file_gives_what_it_holds_and_names_every_missing_plane(seed: Seed) -> None:
    planes = len(seed.pict.places)
    lengths = range(len(seed.data) // 3, len(seed.data), len(seed.data) // 20)
    missing = []
    for length in lengths:
        lost: list[str] = []
        ts.decompress(seed.data[:length], lost=lost)
        missing.append(len(lost))
    assert missing == sorted(missing, reverse=True) and 0 < missing[0] < planes


def test_without_metadata_or_any_depth_there_is_nothing_to_recover(seed: Seed) -> None:
    with pytest.raises(FormatError):
        ts.decompress(_flip(seed.data, 30), lost=[])
    data = seed.data
    for view in (0, 1):
        data = _flip(data, _position(seed, PlaneClass.DEPTH, view))
    with pytest.raises(FormatError):
        ts.decompress(data, lost=[])
    parts = [p for p in seed.parts if p.kind != L.LAYER]
    with pytest.raises(FormatError):
        ts.decompress(join(parts), lost=[])


def test_the_command_says_what_is_lost_in_one_line(seed: Seed, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "f.tsplat").write_bytes(_flip(seed.data, _position(seed, PlaneClass.OPACITY, 1)))
    arguments = ["decode", str(tmp_path / "f.tsplat"), "-o", str(tmp_path / "g.npz")]
    assert cli.main(arguments) == 2
    capsys.readouterr()
    assert cli.main([*arguments, "--partial", "--report", str(tmp_path / "r.json")]) == 0
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and tells(said, "opacity0 view 1")
    assert cli.main(["render", str(tmp_path / "f.tsplat"), "-o", str(tmp_path / "p.png"), "--partial"]) == 0
    capsys.readouterr()
    assert cli.main(["render", str(tmp_path / "g.npz"), "-o", str(tmp_path / "q.png"), "--partial"]) == 2
    assert "--partial" in capsys.readouterr().err
