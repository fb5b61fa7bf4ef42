"""What every Gaussian format that is read and written promises; each adds a line to `KEPT`, and no such tests."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from formats.foreign import on_order_of
from scenes import make_gaussians, make_skewed_cameras, refusing, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import FORMATS, endings, load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.notes import Notes
from tinysplat_runtime.gaussian.quaternions import normalize_quats
from tinysplat_runtime.scene.intake.layouts import load_scene

NOTES = {"unit": "metre", "attribution": "Jo Doe", "licence": "CC-BY-4.0", "antialiased": "yes"}


class Kept(NamedTuple):
    """Largest errors of what comes back: of means, log scales, opacities, angles, colours and other coefficients."""

    means: float
    scales: float
    opacities: float
    angles: float
    colours: float
    coefficients: float
    degree: int = 3


_FLOAT = Kept(1e-6, 1e-6, 1e-6, 1e-3, 1e-6, 1e-6)
_EXACT = _FLOAT._replace(means=0, opacities=0, colours=0, coefficients=0)
KEPT = {
    "npz": _EXACT._replace(degree=4),
    "safetensors": _EXACT._replace(degree=4),
    "compressed PLY": Kept(0.02, 0.01, 0.003, 0.003, 0.03, 0.02),
    "PLY (3DGS)": _FLOAT._replace(means=0, colours=0, coefficients=0),
    "SPZ": Kept(1e-3, 0.04, 0.003, 0.01, 0.02, 0.15),
    "glTF": _EXACT,
    "SOG": Kept(1e-3, 0.1, 0.003, 0.012, 0.02, 0.02),
    "USD": _FLOAT._replace(degree=4),
}
WITH_CAMERAS = {"npz", "safetensors", "glTF"}
ENDINGS = [(form, ending) for form in FORMATS if form.name in KEPT for ending in form.endings]
EACH = pytest.mark.parametrize(("form", "ending"), ENDINGS, ids=[ending for _, ending in ENDINGS])


def some(degree: int) -> Gaussians:
    made = make_gaussians(height=10, width=12, degree=degree).flat()
    sh = 0.3 * made.sh
    return Gaussians(made.means, made.quats, made.scales, made.opacities.clip(0.02, 0.98), sh)


def named(folder: Path, ending: str) -> Path:
    return folder / (f"g{ending}" if ending.startswith(".") else ending)


def saved(path: Path, gaussians: Gaussians, extra: str) -> list[str]:
    """Written, unless this installation lacks the extra that brings the format's package."""
    try:
        return save_gaussians(path, gaussians)
    except InputError as error:
        if extra and "pip install" in str(error):
            pytest.skip(f"needs the extra '{extra}'")
        raise


def test_every_format_that_is_read_and_written_states_what_it_keeps() -> None:
    assert set(KEPT) == {form.name for form in FORMATS if form.read and form.write}


@EACH
@pytest.mark.parametrize("degree", [1, 4])
def test_our_reader_gives_back_what_was_written(form, ending, degree, tmp_path) -> None:
    """Coefficients above what the format has room for are cut, and that alone is said."""
    kept, path = KEPT[form.name], named(tmp_path, ending)
    said = saved(path, some(degree), form.extra)
    assert [tells(line, f"SH {degree} {kept.degree}") for line in said] == [True] * (degree > kept.degree)
    read = load_gaussians(path)
    assert read.degree == min(degree, kept.degree)
    made = on_order_of(some(degree), read)
    sh = np.abs(read.sh - made.sh[:, : read.sh.shape[1]])
    dots = np.abs((normalize_quats(read.quats) * normalize_quats(made.quats)).sum(axis=-1))
    found = Kept(
        np.abs(read.means - made.means).max(),
        np.abs(np.log(read.scales / made.scales)).max(),
        np.abs(read.opacities - made.opacities).max(),
        np.arccos(dots.clip(0, 1)).max(),
        sh[:, 0].max(),
        sh[:, 1:].max(initial=0),
    )
    assert all(a <= b for a, b in zip(found[:6], kept[:6], strict=True)), found


@EACH
def test_the_same_gaussians_give_the_same_bytes(form, ending, tmp_path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        saved(named(tmp_path / name, ending), some(1), form.extra)
    a, b = ({f.name: f.read_bytes() for f in (tmp_path / name).iterdir()} for name in ("a", "b"))
    assert a == b and a


@EACH
def test_notes_come_back_where_there_is_room(form, ending, tmp_path) -> None:
    path, room = named(tmp_path, ending), form.room
    saved(path, some(0).with_notes(Notes(**NOTES)), form.extra)
    read = load_gaussians(path).notes
    assert {name: text for name in NOTES if (text := getattr(read, name))} == {n: NOTES[n] for n in NOTES if n in room}


@EACH
def test_cameras_of_photos_come_back_where_there_is_room(form, ending, tmp_path) -> None:
    path, cameras = named(tmp_path, ending), make_skewed_cameras(3, 10, 12)
    saved(path, replace(some(0), viewpoints=cameras), form.extra)
    found = load_gaussians(path).viewpoints
    assert len(found) == (3 if form.name in WITH_CAMERAS else 0)
    for one, given in zip(found, cameras, strict=False):
        np.testing.assert_allclose(one.c2w, given.c2w, atol=1e-12)
        assert (one.K == given.K).all() and (one.width, one.height) == (given.width, given.height)


@EACH
def test_a_gaussian_of_no_size_comes_back_small(form, ending, tmp_path) -> None:
    path, g = named(tmp_path, ending), some(0)
    scales = g.scales.copy()
    scales[::3] = 0
    saved(path, Gaussians(g.means, g.quats, scales, g.opacities, g.sh), form.extra)
    read = load_gaussians(path)
    assert np.isfinite(read.scales).all() and (np.sort(read.scales.max(axis=-1))[: len(scales[::3])] < 1e-2).all()


@EACH
def test_one_gaussian_comes_back_alone_and_none_is_refused(form, ending, tmp_path) -> None:
    path, g = named(tmp_path, ending), some(0)
    saved(path, Gaussians(g.means[:1], g.quats[:1], g.scales[:1], g.opacities[:1], g.sh[:1]), form.extra)
    read = load_gaussians(path)
    assert read.count == 1
    np.testing.assert_allclose(read.means + read.origin, g.means[:1], atol=1e-2)
    path.write_bytes(b"")
    with pytest.raises(InputError):
        load_gaussians(path)


@EACH
def test_nothing_is_read_past_what_a_caller_allows(form, ending, tmp_path) -> None:
    path, taken = named(tmp_path, ending), sum(getattr(some(1), name).nbytes for name in FIELDS)
    saved(path, some(1), form.extra)
    assert load_gaussians(path, max_bytes=4 * taken).count == some(1).count  # of twice the digits, twice
    with pytest.raises(InputError):
        load_gaussians(path, max_bytes=taken // 3)


@EACH
def test_damaged_files_give_one_line_or_valid_gaussians(form, ending, tmp_path) -> None:
    """`Gaussians` are valid by construction: what is not refused must have got through its checks."""
    path = named(tmp_path, ending)
    saved(path, some(1), form.extra)
    data = path.read_bytes()
    step = max(len(data) // (2 if form.name == "USD" else 12), 1)  # USD's own library takes its time
    damaged = [(length, data[:length]) for length in [*range(0, len(data), step), len(data) - 1]]
    for at in range(0, len(data), step):
        damaged.append((at, data[:at] + bytes([data[at] ^ 1 << at % 8]) + data[at + 1 :]))
    refused = 0
    for _, attack in damaged:
        path.write_bytes(attack)
        try:
            load_gaussians(path)
        except InputError as error:
            refused += 1
            assert str(error).startswith(f"{path}: ") and "\n" not in str(error)
    assert refused


def test_who_takes_a_file_of_gaussians_for_a_scene_is_told_what_it_is() -> None:
    for suffix in {Path(f"g{ending}").suffix for ending in endings(written=False)} - {".json"}:  # most are cameras
        with refusing(InputError, "tinysplat compress"):
            load_scene(f"g{suffix}")
