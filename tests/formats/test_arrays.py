"""Arrays in .npz and .safetensors: what may be announced, to the byte, and which arrays are looked at."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.arrays import read_npz, read_safetensors

MADE = {
    "means": np.arange(6, dtype=np.float64).reshape(2, 3), "opacities": np.array([0.5, 1], np.float16),
    "layer1_means": np.zeros((1, 3), np.float32), "layer12_K": np.zeros((1, 3, 3), np.float32),
    "origin": np.zeros(3, np.float32),
}  # fmt: skip
OTHERS = {"layer0_means": np.zeros(3), "means2": np.zeros(3), "colour": np.zeros(3), "layer1_origin": np.zeros(3)}
BYTES = 6 * 8 + 2 * 2 + 3 * 4 + 9 * 4 + 3 * 4


def saved(folder: Path, kind: str, content: dict[str, np.ndarray]) -> Path:
    path = folder / f"a.{kind}"
    if kind == "npz":
        np.savez_compressed(path, **content)
    else:
        from safetensors.numpy import save_file

        save_file(content, str(path))
    return path


@pytest.mark.parametrize(("kind", "read"), [("npz", read_npz), ("safetensors", read_safetensors)])
def test_arrays_of_gaussians_alone_are_read_and_up_to_the_bytes_allowed(tmp_path: Path, kind: str, read) -> None:
    path = saved(tmp_path, kind, {**MADE, **OTHERS})
    found = read(path, BYTES)
    assert set(found) == set(MADE)
    for name, array in MADE.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype
    said = f"arrays of {BYTES} bytes in all, expected at most {BYTES - 1} of this file"
    with pytest.raises(InputError, match=said):
        read(path, BYTES - 1)


@pytest.mark.parametrize("kind", ["u1", "i2", "i4", "i8", "f2", "f4", "f8"])
@pytest.mark.parametrize("read", [read_npz, read_safetensors])
def test_numbers_of_every_width_count_as_wide_as_they_are(tmp_path: Path, kind: str, read) -> None:
    path = saved(tmp_path, "npz" if read is read_npz else "safetensors", {"means": np.zeros((7, 3), kind)})
    width = int(kind[1])
    assert read(path, 21 * width)["means"].shape == (7, 3)
    with pytest.raises(InputError, match=f"arrays of {21 * width} bytes"):
        read(path, 21 * width - 1)


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.zeros(2, np.complex64), "means: of type complex64, expected float16, float32 or float64"),
        (np.zeros(2, bool), "means: of type bool"), (np.array(["a"]), "means: of type <U1"),
        (np.zeros((1,) * 9), r"means: of shape \(1, 1, 1, 1, 1, 1, 1, 1, 1\)"),
    ],
)  # fmt: skip
def test_what_is_no_array_of_real_numbers_is_refused(tmp_path: Path, array: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_npz(saved(tmp_path, "npz", {"means": array}), 1 << 30)
    assert read_npz(saved(tmp_path, "npz", {"means": np.zeros((1,) * 8)}), 1 << 30)["means"].ndim == 8


def test_members_are_of_numpys_compression_and_exactly_as_long_as_their_shape(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    np.save(buffer, np.zeros(3))
    for data, method, said in (
        (buffer.getvalue() + b"x", zipfile.ZIP_STORED, "means: longer than its shape says"),
        (buffer.getvalue(), zipfile.ZIP_BZIP2, "means: compressed by another method than numpy's"),
    ):
        with zipfile.ZipFile(tmp_path / "a.npz", "w", method) as archive:
            archive.writestr("means.npy", data)
        with pytest.raises(InputError, match=said):
            read_npz(tmp_path / "a.npz", 1 << 30)
