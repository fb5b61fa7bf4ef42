"""3DGS .ply files: the reference layout, conversions both ways, other writers' variants, hostile headers."""

import tracemalloc
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import plyfile
import pytest
from numpy.typing import NDArray
from scenes import make_gaussians, refused, refusing, tells

from tinysplat_runtime.errors import InputError, InputWarning
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats

NAMES = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{i}" for i in range(45)), "opacity"]
NAMES += ["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
refusal = partial(refused, load_gaussians)


def vertices(count: int, degree: int, seed: int = 0, **changes: str | None) -> NDArray:
    """Random vertices as other tools write them; `changes` gives a property another type, or None to leave it out."""
    rng = np.random.default_rng(seed)
    names = [n for n in NAMES if not n.startswith("f_rest") or int(n[7:]) < 3 * ((degree + 1) ** 2 - 1)]
    kept = [(name, changes.get(name, "f4")) for name in names]
    vertex = np.zeros(count, [(name, kind) for name, kind in kept if kind is not None])
    for name in vertex.dtype.names or ():
        vertex[name] = rng.normal(size=count)
    return vertex


def write(path: Path, vertex: NDArray, **options: Any) -> Path:
    plyfile.PlyData([plyfile.PlyElement.describe(vertex, "vertex")], **options).write(str(path))
    return path


def test_written_file_has_the_reference_layout(tmp_path: Path) -> None:
    made = make_gaussians(degree=3).flat()
    assert save_gaussians(tmp_path / "g.ply", made) == []
    data = plyfile.PlyData.read(str(tmp_path / "g.ply"))
    assert (data.text, data.byte_order, [e.name for e in data]) == (False, "<", ["vertex"])
    vertex = data["vertex"].data
    assert list(vertex.dtype.names) == NAMES and all(vertex.dtype[n] == np.float32 for n in NAMES)
    np.testing.assert_array_equal(np.stack([vertex[n] for n in "xyz"], -1), made.means)
    assert not any(vertex[n].any() for n in ("nx", "ny", "nz"))
    for b in range(1, 16):
        for c in range(3):  # all of red first, then green, then blue
            np.testing.assert_array_equal(vertex[f"f_rest_{15 * c + b - 1}"], made.sh[:, b, c])
    np.testing.assert_allclose(1 / (1 + np.exp(-vertex["opacity"])), made.opacities, rtol=1e-5)
    np.testing.assert_allclose(np.exp(vertex["scale_1"]), made.scales[:, 1], rtol=1e-5)
    np.testing.assert_allclose(vertex["rot_0"], normalize_quats(made.quats)[:, 0], atol=1e-7)


def test_origin_is_added_and_far_positions_are_double(tmp_path: Path) -> None:
    made = make_gaussians()
    fields = {name: getattr(made, name) for name in FIELDS}
    for origin, kind in [
        (np.array([1.0, 2, 3]), np.float32),
        (np.array([431_000.25, 5_411_000.75, 210.5]), np.float64),
    ]:
        notes = save_gaussians(tmp_path / "g.ply", Gaussians(**fields, origin=origin))
        vertex = plyfile.PlyData.read(str(tmp_path / "g.ply"))["vertex"].data
        assert {vertex.dtype[n].type for n in "xyz"} == {kind}
        assert bool(notes) == (kind == np.float64)
        loaded = load_gaussians(tmp_path / "g.ply")
        error = np.abs(loaded.means + loaded.origin - (made.flat().means.astype(np.float64) + origin))
        assert error.max() < 1e-6


@pytest.mark.parametrize("options", [{"byte_order": ">"}, {"text": True}], ids=str)
def test_other_encodings_and_column_orders_load(tmp_path: Path, options: dict[str, Any]) -> None:
    vertex = vertices(5, degree=2, nx=None, ny=None, nz=None)
    names = list(reversed(vertex.dtype.names or ()))
    reordered = np.zeros(5, [(name, "f4") for name in names])
    for name in names:
        reordered[name] = vertex[name]
    plain = load_gaussians(write(tmp_path / "a.ply", vertex))
    other = load_gaussians(write(tmp_path / "b.ply", reordered, **options))
    for name in FIELDS:
        np.testing.assert_allclose(getattr(other, name), getattr(plain, name), rtol=1e-6)


def test_other_layouts_are_refused_with_what_they_lack(tmp_path: Path) -> None:
    cases: list[tuple[NDArray, str]] = [
        (vertices(3, 1, scale_1=None), "lacks scale_1"),
        (vertices(3, 1, opacity=None, rot_0=None), "lacks opacity, rot_0"),
        (vertices(3, 1, f_rest_7=None, f_rest_8=None), "7 f_rest properties"),
        (vertices(3, 1, **{f"f_rest_{i}": None for i in range(3, 9)}), "sh: 2 basis functions"),
    ]
    for number, (vertex, words) in enumerate(cases):
        assert tells(refusal(write(tmp_path / f"{number}.ply", vertex)), words)
    lists = vertices(3, 1, x="O")
    lists["x"] = [np.zeros(n, "f4") for n in range(3)]
    refusal(write(tmp_path / "lists.ply", lists))
    face = plyfile.PlyElement.describe(np.array([([0, 1, 2],)], [("vertex_indices", "i4", (3,))]), "face")
    plyfile.PlyData([face]).write(str(tmp_path / "mesh.ply"))
    refusal(tmp_path / "mesh.ply")


HEADER = b"ply\nformat %s 1.0\nelement vertex %s\nproperty float x\nproperty list uchar int y\nend_header\n"
HOSTILE = {
    "binary bomb": HEADER % (b"binary_little_endian", b"100000000000"),
    "ascii bomb": HEADER % (b"ascii", b"100000000000"),
    "no properties": b"ply\nformat ascii 1.0\nelement vertex 100000000000\nend_header\n",
    "endless count": HEADER % (b"ascii", b"9" * 5000),
    "mac line ends": (HEADER % (b"ascii", b"100000000000")).replace(b"\n", b"\r"),
    "no end": b"ply\nformat ascii 1.0\ncomment " + b"x" * 100_000,
    "nothing": b"",
    "words": (HEADER % (b"ascii", b"2")) + b"one two three four\n",
}


@pytest.mark.parametrize("data", HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_files_are_refused_within_memory(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "g.ply").write_bytes(data)
    tracemalloc.start()
    refusal(tmp_path / "g.ply")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8 << 20


def trained(count: int = 40) -> NDArray:
    """Vertices as training leaves them: small Gaussians, logits and coefficients of either sign."""
    vertex = vertices(count, 1)
    for name in ("scale_0", "scale_1", "scale_2"):
        vertex[name] -= 4
    return vertex


def warnings_of(path: Path) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load_gaussians(path)
    assert all(issubclass(entry.category, InputWarning) for entry in caught)
    return [str(entry.message) for entry in caught]


@pytest.mark.parametrize(
    ("columns", "change", "words"),
    [
        (("opacity",), lambda x: 1 / (1 + np.exp(-x)), "opacities 0.5 0.731"),
        (("opacity",), lambda x: 255 / (1 + np.exp(-x)), "opacity 255"),
        (("f_dc_0", "f_dc_1", "f_dc_2"), lambda x: np.clip(0.5 + 0.282 * x, 0, 1), "f_dc_0"),
        (("f_dc_0", "f_dc_1", "f_dc_2"), lambda x: np.clip(127 + 72 * x, 0, 255), "255"),
    ],
)
def test_linear_values_are_told(tmp_path: Path, columns, change, words: str) -> None:
    vertex = trained()
    assert warnings_of(write(tmp_path / "g.ply", vertex)) == []
    for name in columns:
        vertex[name] = change(vertex[name].astype(np.float64))
    said = warnings_of(write(tmp_path / "g.ply", vertex))
    assert any(tells(line, words) for line in said) and all(line.startswith(str(tmp_path / "g.ply")) for line in said)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 10.0, 1e2, 1e4])
def test_linear_scales_are_told_at_any_size_of_scene(tmp_path: Path, unit: float) -> None:
    """Gaussians about as large as they lie apart, as logarithms and as they are."""
    rng = np.random.default_rng(0)
    vertex, sizes = trained(1000), unit * rng.lognormal(np.log(0.1), 0.6, (1000, 3))
    for axis, name in enumerate("xyz"):
        vertex[name] *= unit
        vertex[f"scale_{axis}"] = np.log(sizes[:, axis])
    assert warnings_of(write(tmp_path / "g.ply", vertex)) == []
    whole = load_gaussians(tmp_path / "g.ply")
    arrays = {field: getattr(whole, field) for field in FIELDS}
    np.savez(tmp_path / "g.npz", **arrays)
    assert warnings_of(tmp_path / "g.npz") == []
    for axis in range(3):
        vertex[f"scale_{axis}"] = np.minimum(sizes[:, axis], 80)  # more would be infinite, and is refused
    assert any("linear" in line for line in warnings_of(write(tmp_path / "g.ply", vertex)))
    if unit > 1e3:  # elsewhere some are negative, which is refused
        np.savez(tmp_path / "g.npz", **{**arrays, "scales": np.log(sizes).astype(np.float32)})
        assert any("logarithms" in line for line in warnings_of(tmp_path / "g.npz"))


def with_columns(vertex: NDArray, **columns: NDArray) -> NDArray:
    kinds = [(name, vertex.dtype[name]) for name in vertex.dtype.names or () if name not in columns]
    wider = np.zeros(len(vertex), [*kinds, *((name, column.dtype) for name, column in columns.items())])
    for name in wider.dtype.names or ():
        wider[name] = columns[name] if name in columns else vertex[name]
    return wider


def test_a_filter_of_mip_splatting_is_what_covariances_and_opacities_are_worth(tmp_path: Path) -> None:
    vertex, width = trained(), np.linspace(0, 0.1, 40).astype(np.float32)
    plain = load_gaussians(write(tmp_path / "a.ply", vertex))
    path = write(tmp_path / "b.ply", with_columns(vertex, filter_3D=width))
    assert warnings_of(path) == []
    seen = load_gaussians(path)
    np.testing.assert_allclose(seen.scales**2, plain.scales**2 + width[:, None] ** 2, rtol=1e-5)
    mass = [g.opacities * g.scales.prod(axis=1) for g in (seen, plain)]
    np.testing.assert_allclose(*mass, rtol=1e-5)
    width[7] = np.nan
    with pytest.warns(InputWarning, match="1 of 40"):
        assert load_gaussians(write(tmp_path / "c.ply", with_columns(vertex, filter_3D=width))).count == 39


@pytest.mark.parametrize(
    ("names", "words"),
    [(("t", "scale_t"), "moves"), (("trbf_center",), "moves"), (("beta",), "kernels"), (("label",), "Splatting")],
)
def test_what_is_ignored_is_named_with_what_it_means(tmp_path: Path, names: tuple[str, ...], words: str) -> None:
    path = write(tmp_path / "a.ply", with_columns(trained(), **{name: np.ones(40, np.float32) for name in names}))
    (line,) = warnings_of(path)
    assert words in line and all(name in line for name in names)


def test_normals_and_colours_beside_coefficients_are_no_matter(tmp_path: Path) -> None:
    colours = {name: np.full(40, 9, np.uint8) for name in ("red", "green", "blue", "alpha")}
    assert warnings_of(write(tmp_path / "a.ply", with_columns(trained(), **colours))) == []


@pytest.mark.parametrize("kind", ["u1", "u2", "f4", "f4 of 255"])
def test_colours_stand_in_for_coefficients(tmp_path: Path, kind: str) -> None:
    rgb = np.random.default_rng(0).uniform(0, 1, (40, 3))
    largest = {"u1": 255, "u2": 65535, "f4": 1, "f4 of 255": 255}[kind]
    stored = (rgb * largest).astype(kind[:2])
    vertex = vertices(40, 0, f_dc_0=None, f_dc_1=None, f_dc_2=None)
    path = write(tmp_path / "a.ply", with_columns(vertex, **dict(zip(("red", "green", "blue"), stored.T, strict=True))))
    np.testing.assert_allclose(0.5 + load_gaussians(path).sh[:, 0] * 0.28209479, rgb, atol=1 / 255)


def test_two_scales_are_a_disc(tmp_path: Path) -> None:
    with pytest.warns(InputWarning, match="2D Gaussian"):
        disc = load_gaussians(write(tmp_path / "a.ply", vertices(40, 1, scale_2=None)))
    assert not disc.scales[:, 2].any() and disc.scales[:, :2].all()


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "utf-16"])
def test_comments_may_be_in_any_encoding(tmp_path: Path, text: bool, encoding: str) -> None:
    path = write(tmp_path / "a.ply", trained(), text=text)
    plain, comment = load_gaussians(path), b"comment " + "Gelände".encode(encoding) + b"\nelement vertex"
    path.write_bytes(path.read_bytes().replace(b"element vertex", comment, 1))
    np.testing.assert_array_equal(load_gaussians(path).means, plain.means)


def test_a_pointer_of_git_lfs_is_told_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 132735\n")
    assert tells(refusal(tmp_path / "a.ply"), "LFS `git lfs pull`")


def test_points_without_a_rotation_are_dropped_and_counted(tmp_path: Path) -> None:
    vertex = trained()
    for name in ("rot_0", "rot_1", "rot_2", "rot_3"):
        vertex[name][3:] = 0
    with pytest.warns(InputWarning, match="37 of 40"):
        assert load_gaussians(write(tmp_path / "g.ply", vertex)).count == 3
    vertex["rot_0"] = vertex["rot_1"] = vertex["rot_2"] = vertex["rot_3"] = 0
    assert tells(refusal(write(tmp_path / "g.ply", vertex)), "quats 40")


@pytest.mark.parametrize("name", ["x", "rot_1", "scale_2", "opacity", "f_dc_0", "f_rest_3"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_points_with_nan_are_dropped_and_counted(tmp_path: Path, name: str, value: float) -> None:
    vertex = trained()
    whole = load_gaussians(write(tmp_path / "g.ply", vertex))
    vertex[name][[3, 17]] = value
    if (name, value) == ("opacity", np.inf):  # the logit of 1
        assert warnings_of(write(tmp_path / "g.ply", vertex)) == []
        return
    with pytest.warns(InputWarning) as caught:
        left = load_gaussians(write(tmp_path / "g.ply", vertex))
    assert any(tells(str(entry.message), f"{tmp_path / 'g.ply'} 2 40") for entry in caught)
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(left, field), np.delete(getattr(whole, field), [3, 17], axis=0))


SIZES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2, "int": 4, "uint": 4,
    "int32": 4, "uint32": 4, "float": 4, "float32": 4, "double": 8, "float64": 8,
}  # fmt: skip


@pytest.mark.parametrize("kind", SIZES)
def test_a_file_is_as_long_as_its_header_announces(kind: str, tmp_path: Path) -> None:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex 7\nproperty {kind} x\nproperty uchar y\nend_header\n"
    length = len(head) + 7 * (SIZES[kind] + 1)
    path = tmp_path / "a.ply"
    path.write_bytes(head.encode() + bytes(length - len(head)))
    with refusing(InputError, "opacity"):
        load_gaussians(path)
    path.write_bytes(path.read_bytes()[:-1])
    with refusing(InputError, f"{length - 1} {length}"):
        load_gaussians(path)
