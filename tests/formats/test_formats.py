"""Gaussian files: exact round trips, precision far from the origin, and hostile files refused within memory."""

import io
import tracemalloc
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from safetensors.numpy import save_file
from scenes import assert_same, make_cameras, make_gaussians, refused, refusing, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians

refusal = partial(refused, load_gaussians)
BOTH = pytest.mark.parametrize("suffix", [".npz", ".safetensors"])


def arrays_of(gaussians: Gaussians, **changes: NDArray | None) -> dict[str, NDArray]:
    """What a network's output file holds for single-layer Gaussians; None leaves an array out."""
    arrays: dict[str, Any] = {name: getattr(gaussians, name) for name in FIELDS}
    arrays["K"] = np.stack([c.K for c in gaussians.cameras])
    arrays["c2w"] = np.stack([c.c2w for c in gaussians.cameras])
    return {name: array for name, array in {**arrays, **changes}.items() if array is not None}


def write(path: Path, arrays: dict[str, Any]) -> Path:
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    else:
        save_file({name: np.ascontiguousarray(array) for name, array in arrays.items()}, path)
    return path


@BOTH
def test_layers_of_other_poses_keep_them(tmp_path: Path, suffix: str) -> None:
    base, coarse = make_gaussians(), make_gaussians(height=4, width=6)
    moved = replace(coarse, cameras=tuple(make_cameras(2, 4, 6, spacing=0.5)))
    both = Gaussians(**{n: getattr(base, n) for n in FIELDS}, cameras=base.cameras, extra_layers=(moved,))
    save_gaussians(tmp_path / f"g{suffix}", both)
    assert_same(load_gaussians(tmp_path / f"g{suffix}"), both)


def test_big_endian_and_fortran_arrays_load(tmp_path: Path) -> None:
    made = make_gaussians()
    arrays = arrays_of(made, means=np.asfortranarray(made.means.astype(">f8")), sh=made.sh.astype(">f4"))
    assert_same(load_gaussians(write(tmp_path / "g.npz", arrays)), made)


UTM = np.array([431_000.25, 5_411_000.75, 210.5])


@pytest.mark.parametrize("with_cameras", [True, False])
@pytest.mark.parametrize("stored_origin", [None, UTM - 1000])
def test_float64_means_far_from_the_origin_keep_their_precision(
    tmp_path: Path, with_cameras: bool, stored_origin: NDArray | None
) -> None:
    made = make_gaussians()
    true = made.means.astype(np.float64) + UTM
    c2w = np.stack([c.c2w for c in made.cameras])
    c2w[:, :3, 3] += UTM
    offset = np.zeros(3) if stored_origin is None else stored_origin
    arrays = arrays_of(made, means=true - offset, c2w=c2w, origin=stored_origin)
    if not with_cameras:
        del arrays["K"], arrays["c2w"]
    loaded = load_gaussians(write(tmp_path / "g.npz", arrays))
    distance = np.linalg.norm(made.means[..., None, :] - [c.centre for c in made.cameras], axis=-1).min(axis=-1)
    error = np.linalg.norm(loaded.means + loaded.origin - true, axis=-1)
    assert (error <= 1e-6 * distance).all()
    np.testing.assert_allclose(loaded.origin, UTM, atol=20)
    np.testing.assert_allclose(loaded.means, made.means, atol=20)  # small numbers, not 5 million
    save_gaussians(tmp_path / "again.npz", loaded)
    assert_same(load_gaussians(tmp_path / "again.npz"), loaded)


def test_lists_become_pixels_where_grid_or_cameras_say_so(tmp_path: Path) -> None:
    made = make_gaussians()
    flat = made.flat()
    path = write(tmp_path / "g.npz", {name: getattr(flat, name) for name in FIELDS})
    assert load_gaussians(path).means.shape == (192, 3)
    gridded = load_gaussians(path, grid=(2, 8, 12))
    assert gridded.means.shape == (2, 8, 12, 3) and not gridded.cameras
    assert_same(load_gaussians(path, cameras=made.cameras), made)
    assert_same(load_gaussians(path, grid=(2, 8, 12), cameras=made.cameras), made)
    assert_same(load_gaussians(path, cameras=list(made.cameras), grid=None), made)
    assert tells(refusal(path, grid=(2, 8, 13)), "2 8 13")
    refusal(path, grid=(2, 8, 12), cameras=make_cameras(2, 9, 12))
    flat_with_cameras = write(tmp_path / "h.npz", {**arrays_of(made), **{n: getattr(flat, n) for n in FIELDS}})
    assert "--grid" in refusal(flat_with_cameras)
    assert_same(load_gaussians(flat_with_cameras, grid=(2, 8, 12)), made)


MADE = make_gaussians()
FAULTS: list[tuple[dict[str, Any], str]] = [
    ({"means": None, "sh": None}, "sh"),
    ({"c2w": None}, "K without c2w"),
    ({"c2w": np.zeros((3, 4, 4))}, "c2w: shape (3, 4, 4), expected (2, 4, 4)"),
    ({"K": np.stack([np.eye(3), -np.eye(3)])}, "K[1]: focal length"),
    ({"opacities": MADE.opacities[..., None]}, "opacities: shape (2, 8, 12, 1), expected (V, H, W) or (N,)"),
    ({"scales": MADE.scales[:1]}, "scales: shape (1, 8, 12, 3), expected (2, 8, 12, 3)"),
    ({"opacities": MADE.opacities * 3 - 1}, "0 to 1 (linear)"),
    ({"means": MADE.means * np.nan}, "means[0, 0, 0, 0]: nan"),
    ({"means": MADE.means.astype(np.float64) * 1e300}, "means[0, 0, 0, 0]: "),
    ({"sh": MADE.sh[..., :3, :]}, "sh: 3 basis functions"),
    ({"origin": np.zeros(2)}, "origin: shape (2,), expected (3,)"),
    ({"means": np.zeros((2, 8, 12, 3), bool)}, "means"),
    ({"layer1_means": MADE.means}, "lacks layer1_quats"),
    ({f"layer1_{n}": getattr(MADE, n) for n in FIELDS}, "layer1: expected per-pixel Gaussians"),
]


@BOTH
@pytest.mark.parametrize(("changes", "words"), FAULTS, ids=[words for _, words in FAULTS])
def test_fault_is_named_by_file_and_array(
    tmp_path: Path, suffix: str, changes: dict[str, NDArray | None], words: str
) -> None:
    path = tmp_path / f"g{suffix}"
    assert tells(refusal(write(path, arrays_of(MADE, **changes))), words)


def test_intrinsics_divided_by_the_image_size_are_noticed(tmp_path: Path) -> None:
    made = make_gaussians(height=16, width=20)
    K_unit = np.stack([c.K_unit for c in made.cameras])
    assert "K[0]" in refusal(write(tmp_path / "g.npz", arrays_of(made, K=K_unit)))


def test_unknown_suffixes_are_refused_with_the_list(tmp_path: Path) -> None:
    for name in ("g.obj", "g"):
        for call in (load_gaussians, lambda path: save_gaussians(path, MADE)):
            with pytest.raises(InputError) as caught:
                call(tmp_path / name)
            assert caught.value.where == str(tmp_path / name)
            assert all(ending in str(caught.value) for ending in (".npz", ".safetensors", ".ply"))
    refusal(tmp_path / "missing.npz")
    (tmp_path / "folder.npz").mkdir()
    refusal(tmp_path / "folder.npz")


def test_a_path_and_gaussians_the_wrong_way_round_are_told() -> None:
    for given in ((MADE, "g.ply"), (MADE, MADE), ("g.ply", "g.ply")):
        with refusing(InputError, "Gaussians"):
            save_gaussians(*given)  # type: ignore[arg-type]


@pytest.mark.parametrize(("suffix", "package"), [(".safetensors", "safetensors"), (".ply", "plyfile")])
def test_missing_package_is_named_with_what_to_install(
    tmp_path: Path, missing: Callable[..., None], suffix: str, package: str
) -> None:
    path = tmp_path / f"g{suffix}"
    save_gaussians(path, MADE)
    content = path.read_bytes()
    missing(package)
    assert 'pip install "tinysplat[io]"' in refusal(path)
    with refusing(InputError, "tinysplat"):
        save_gaussians(path, MADE)
    assert path.read_bytes() == content and list(tmp_path.iterdir()) == [path]


# ---- hostile files -----------------------------------------------------------------------------------------------


def npz_of_members(path: Path, members: dict[str, bytes], compression: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def npy_header(text: str) -> bytes:
    encoded = text.encode("latin1") + b"\n"
    return b"\x93NUMPY\1\0" + len(encoded).to_bytes(2, "little") + encoded


def described(shape: str, descr: str = "'<f4'") -> str:
    return f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}}}"


HEADERS = {
    "2 GB": described("(536870912,)"),
    "beyond 64 bits": described("(4294967296, 4294967296, 4294967296)"),
    "negative": described("(-1, 3)"),
    "objects": described("(2,)", "'|O'"),
    "records": described("(2,)", "[('a', '<f4')]"),
    "nested type": described("(2,)", "('<f4', (536870912,))"),
    "strings": described("(2,)", "'<U1000000000'"),
    "no shape": "{'descr': '<f4', 'fortran_order': False}",
    "code": "__import__('os').getcwd()",
    "deep": "(" * 5000,
    "long": described("(2,)") + " " * 60000,
    "too short for its data": described("(2, 8, 12, 3)"),
}


@pytest.mark.parametrize("header", HEADERS.values(), ids=HEADERS.keys())
@pytest.mark.filterwarnings("ignore::UserWarning")  # numpy's, about headers of Python 2
def test_hostile_npy_headers_are_refused_before_memory_is_taken(tmp_path: Path, header: str) -> None:
    path = npz_of_members(tmp_path / "g.npz", {"means.npy": npy_header(header) + bytes(64)})
    tracemalloc.start()
    refusal(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8 << 20


def test_zip_bombs_are_refused_by_their_expansion(tmp_path: Path) -> None:
    data = io.BytesIO()
    np.save(data, np.zeros((1 << 22,), np.float32))
    path = npz_of_members(tmp_path / "g.npz", {"means.npy": data.getvalue()})
    assert path.stat().st_size < 1 << 16
    assert "16777216" in refusal(path, max_bytes=1 << 20)


def test_npz_with_damaged_data_is_refused_by_its_checksum(tmp_path: Path) -> None:
    data = bytearray(write(tmp_path / "g.npz", arrays_of(MADE)).read_bytes())
    position = data.index(MADE.means.tobytes()) + 5
    data[position] ^= 1
    (tmp_path / "g.npz").write_bytes(data)
    assert refusal(tmp_path / "g.npz")


def test_npz_with_more_data_than_its_shape_or_another_method_is_refused(tmp_path: Path) -> None:
    body = npy_header(described("(2,)")) + bytes(8)
    assert "means" in refusal(npz_of_members(tmp_path / "g.npz", {"means.npy": body + bytes(3)}))
    assert "means" in refusal(npz_of_members(tmp_path / "g.npz", {"means.npy": body}, zipfile.ZIP_LZMA))
