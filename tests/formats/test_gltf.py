"""glTF: what a reader of the specification's words finds in our files, and what we find in files made by hand."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign import foreign_model
from numpy.typing import NDArray
from scenes import make_gaussians

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.notes import Notes
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.gaussian.sh import sh_basis
from tinysplat_runtime.scene.cameras import Camera

TURN = np.array([1.0, -1.0, -1.0])  # glTF has y up and z backward
PREFIX = "KHR_gaussian_splatting"
SPZ = "KHR_gaussian_splatting_compression_spz_2"
TYPES = {5120: "b", 5121: "B", 5122: "h", 5123: "H", 5126: "f"}


def parts_of(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON and the binary chunk of a .glb, byte by byte as the container's specification has them."""
    data = path.read_bytes()
    magic, version, total = struct.unpack_from("<4sII", data)
    assert (magic, version, total) == (b"glTF", 2, len(data))
    length, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON" and length % 4 == 0
    size, kind = struct.unpack_from("<I4s", data, 20 + length)
    assert kind == b"BIN\0" and 28 + length + size == total
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def attribute(document: dict[str, Any], binary: bytes, name: str) -> NDArray:
    accessor = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"][name]]
    view = document["bufferViews"][accessor["bufferView"]]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
    values = [
        struct.unpack_from(f"<{width}{TYPES[accessor['componentType']]}", binary, view["byteOffset"] + i)
        for i in range(0, view["byteLength"], view["byteLength"] // accessor["count"])
    ]
    return np.array(values)


def covariances(quats: NDArray, scales: NDArray) -> NDArray:
    axes = quats_to_matrices(normalize_quats(quats.astype(np.float64))) * scales[:, None]
    return axes @ axes.swapaxes(1, 2)


def test_a_reader_of_the_specification_finds_our_gaussians(tmp_path: Path) -> None:
    made = make_gaussians(degree=3)
    save_gaussians(tmp_path / "a.glb", made)
    document, binary = parts_of(tmp_path / "a.glb")
    flat = made.flat()
    means = attribute(document, binary, "POSITION") * TURN
    np.testing.assert_array_equal(means.astype(np.float32), flat.means)
    accessor = document["accessors"][0]
    np.testing.assert_allclose(accessor["min"], (flat.means * TURN).min(axis=0), rtol=1e-7)
    np.testing.assert_allclose(accessor["max"], (flat.means * TURN).max(axis=0), rtol=1e-7)
    x, y, z, w = attribute(document, binary, f"{PREFIX}:ROTATION").T
    scales = attribute(document, binary, f"{PREFIX}:SCALE")
    found = covariances(np.stack([w, x, y, z], axis=1), scales) * (TURN[:, None] * TURN)
    np.testing.assert_allclose(found, covariances(flat.quats, flat.scales), rtol=0, atol=1e-6 * flat.scales.max() ** 2)
    np.testing.assert_array_equal(attribute(document, binary, f"{PREFIX}:OPACITY")[:, 0], flat.opacities)
    directions = normalize_quats(np.random.default_rng(0).normal(size=(5, 4)))[:, :3]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    names = [f"{PREFIX}:SH_DEGREE_{band}_COEF_{n}" for band in range(4) for n in range(2 * band + 1)]
    sh = np.stack([attribute(document, binary, name) for name in names], axis=1)
    seen = np.einsum("db,nbc->ndc", sh_basis(directions * TURN, 3), sh)
    np.testing.assert_allclose(seen, np.einsum("db,nbc->ndc", sh_basis(directions, 3), flat.sh), atol=1e-6)


def test_extension_fallback_cameras_and_notes_stand_where_the_specification_wants_them(tmp_path: Path) -> None:
    made = make_gaussians().with_notes(Notes("metre", "Jo Doe", "CC-BY-4.0"))
    save_gaussians(tmp_path / "a.glb", made)
    document, binary = parts_of(tmp_path / "a.glb")
    assert document["extensionsUsed"] == [PREFIX] and "extensionsRequired" not in document
    primitive = document["meshes"][0]["primitives"][0]
    assert primitive["mode"] == 0
    assert primitive["extensions"][PREFIX]["kernel"] == "ellipse"
    assert primitive["extensions"][PREFIX]["colorSpace"] == "srgb_rec709_display"
    assert document["asset"]["copyright"] == "Jo Doe; CC-BY-4.0"
    fallback = attribute(document, binary, "COLOR_0") / 65535
    rgb = (0.5 + 0.28209479177387814 * made.flat().sh[:, 0]).clip(0, 1)
    shown = np.where(
        fallback[:, :3] <= 0.0031308, fallback[:, :3] * 12.92, 1.055 * fallback[:, :3] ** (1 / 2.4) - 0.055
    )
    np.testing.assert_allclose(shown, rgb, atol=1e-3)
    node = document["nodes"][2]
    look = np.array(node["matrix"]).reshape(4, 4).T @ [0, 0, -1, 0]  # glTF cameras look along −z
    np.testing.assert_allclose(look[:3] * TURN, made.cameras[1].c2w[:3, 2], atol=1e-12)
    yfov = document["cameras"][1]["perspective"]["yfov"]
    assert np.tan(yfov / 2) == pytest.approx(made.cameras[1].height / 2 / made.cameras[1].K[1, 1])
    assert load_gaussians(tmp_path / "a.glb").notes == made.notes


def test_far_scenes_keep_their_digits_in_the_nodes_translation(tmp_path: Path) -> None:
    flat = make_gaussians().flat()
    far = Gaussians(flat.means, flat.quats, flat.scales, flat.opacities, flat.sh, origin=np.array([5e5, 4e6, 300.0]))
    save_gaussians(tmp_path / "far.glb", far)
    read = load_gaussians(tmp_path / "far.glb")
    np.testing.assert_allclose(read.means.astype(np.float64) + read.origin, far.means + far.origin, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("degree", "version"), [(1, 3), (2, 2), (3, 3), (4, 3)])
def test_the_draft_s_reader_finds_an_spz_file_and_what_it_unpacks_to(tmp_path: Path, degree: int, version: int) -> None:
    made = make_gaussians(degree=degree)
    save_gaussians(tmp_path / "a.spz", made, (8, 8), version)
    losses = save_gaussians(tmp_path / "a.glb", made, (8, 8), version, gltf_spz=True)
    assert bool(losses) == (degree == 4)
    document, binary = parts_of(tmp_path / "a.glb")
    assert document["extensionsUsed"] == document["extensionsRequired"] == [PREFIX, SPZ]
    primitive = document["meshes"][0]["primitives"][0]
    assert primitive["extensions"][PREFIX]["extensions"] == {SPZ: {"bufferView": 0}}
    [view] = document["bufferViews"]
    data = binary[: view["byteLength"]]
    assert view["byteOffset"] == 0 and data == (tmp_path / "a.spz").read_bytes()
    unpacked = foreign_model(data, "spz")
    names = [
        f"{PREFIX}:SH_DEGREE_{band}_COEF_{n}" for band in range(1, min(degree, 3) + 1) for n in range(2 * band + 1)
    ]
    assert list(primitive["attributes"]) == ["POSITION", "COLOR_0", f"{PREFIX}:ROTATION", f"{PREFIX}:SCALE", *names]
    for accessor in document["accessors"]:
        assert "bufferView" not in accessor and accessor["count"] == made.count
    position = document["accessors"][0]
    np.testing.assert_allclose(position["min"], unpacked["positions"].min(axis=0), rtol=1e-6)
    np.testing.assert_allclose(position["max"], unpacked["positions"].max(axis=0), rtol=1e-6)


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_gltf_with_spz_reads_back_as_the_spz_file_does_where_its_node_puts_it(tmp_path: Path, suffix: str) -> None:
    made = make_gaussians(degree=2).with_notes(Notes("metre", "Jo Doe", antialiased="yes"))
    save_gaussians(tmp_path / "a.spz", made)
    assert save_gaussians(tmp_path / f"a{suffix}", made, gltf_spz=True) == []
    read, plain = load_gaussians(tmp_path / f"a{suffix}"), load_gaussians(tmp_path / "a.spz")
    for name in ("means", "quats", "scales", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(read, name), getattr(plain, name))
    assert read.notes == made.notes
    flat, origin = made.flat(), np.array([5e5, 4e6, 300.0])
    far = Gaussians(flat.means, flat.quats, flat.scales, flat.opacities, flat.sh, origin=origin)
    save_gaussians(tmp_path / f"far{suffix}", far, gltf_spz=True)
    read = load_gaussians(tmp_path / f"far{suffix}")
    np.testing.assert_allclose(read.means.astype(np.float64) + read.origin - origin, plain.means, atol=1e-6)


def test_gltf_with_spz_that_contradicts_itself_or_its_draft_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="4 within glTF, expected at most 3"):
        save_gaussians(tmp_path / "a.gltf", make_gaussians(), spz_version=4, gltf_spz=True)
    save_gaussians(tmp_path / "a.gltf", make_gaussians(), gltf_spz=True)
    document = json.loads((tmp_path / "a.gltf").read_text())
    document["accessors"][0]["count"] += 1
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"POSITION: .* positions, but .* in its SPZ"):
        load_gaussians(tmp_path / "a.gltf")


def by_hand(path: Path, change: Any = None) -> None:
    """Two Gaussians in a .gltf with quantised, interleaved and strided values under two nodes."""
    rows = [  # position f32×3, rotation i16×4, scale u8×3 + 1 spare, opacity u16 + 2 spare, colour f32×3
        struct.pack("<3f4h3Bx1Hxx3f", 1, 2, 3, 0, 0, 0, 32767, 51, 102, 255, 65535, 0.1, 0.2, 0.3),
        struct.pack("<3f4h3Bx1Hxx3f", 4, 5, 6, 32767, 0, 0, 0, 255, 51, 51, 32768, 0, 0, 0),
    ]
    data, stride = b"".join(rows), len(rows[0])
    names = ["POSITION", *(f"{PREFIX}:{name}" for name in ("ROTATION", "SCALE", "OPACITY", "SH_DEGREE_0_COEF_0"))]
    kinds = [(0, 5126, "VEC3"), (12, 5122, "VEC4"), (20, 5121, "VEC3"), (24, 5123, "SCALAR"), (28, 5126, "VEC3")]
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"translation": [0, 0, 10], "children": [1]}, {"scale": [2, 2, 2], "mesh": 0}],
        "meshes": [
            {
                "primitives": [
                    {
                        "mode": 0,
                        "attributes": {name: i for i, name in enumerate(names)},
                        "extensions": {PREFIX: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}},
                    }
                ]
            }
        ],
        "accessors": [
            {
                "bufferView": 0,
                "byteOffset": offset,
                "componentType": kind,
                "count": 2,
                "type": shape,
                "normalized": True,
            }
            for offset, kind, shape in kinds
        ],
        "bufferViews": [{"buffer": 0, "byteLength": len(data), "byteStride": stride}],
        "buffers": [{"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()}],
    }
    if change is not None:
        change(document)
    path.write_text(json.dumps(document))


def test_quantised_strided_accessors_and_nodes_are_read(tmp_path: Path) -> None:
    by_hand(tmp_path / "hand.gltf")
    read = load_gaussians(tmp_path / "hand.gltf")
    np.testing.assert_allclose(read.means, np.array([[2, 4, 16], [8, 10, 22]]) * TURN, rtol=1e-6)
    np.testing.assert_allclose(read.scales, 2 * np.array([[51, 102, 255], [255, 51, 51]]) / 255, rtol=1e-6)
    np.testing.assert_allclose(read.opacities, [1, 32768 / 65535], rtol=1e-6)
    np.testing.assert_allclose(read.sh[:, 0], [[0.1, 0.2, 0.3], [0, 0, 0]], atol=1e-7)
    np.testing.assert_allclose(np.abs(read.quats), [[1, 0, 0, 0], [0, 1, 0, 0]], atol=1e-4)


@pytest.mark.parametrize("component", [5120, 5121, 5122, 5123, 5125, 5126])
@pytest.mark.parametrize("normalised", [True, False])
def test_every_type_of_number_is_read_as_the_specification_has_it(
    tmp_path: Path, component: int, normalised: bool
) -> None:
    """Normalised integers are value / largest, and at least −1; opacities here, whose stored number is known."""
    letter, largest = {**{k: (v, 2 ** (8 * struct.calcsize(v) - v.islower()) - 1) for k, v in TYPES.items()},
                       5125: ("I", 2**32 - 1), 5126: ("f", 1)}[component]  # fmt: skip
    value = 1 if component == 5126 or not normalised else largest // 3

    def change(document: dict[str, Any]) -> None:
        data = struct.pack(f"<2{letter}", value, 0)
        document["bufferViews"].append({"buffer": 1, "byteLength": len(data)})
        document["buffers"].append({"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()})
        accessor = {"bufferView": 1, "componentType": component, "count": 2, "type": "SCALAR", "normalized": normalised}
        document["accessors"][3] = accessor

    by_hand(tmp_path / "a.gltf", change)
    wanted = value / largest if normalised else 1
    np.testing.assert_allclose(load_gaussians(tmp_path / "a.gltf").opacities, [wanted, 0], rtol=1e-6)


@pytest.mark.parametrize(("component", "letter", "least"), [(5120, "b", -128), (5122, "h", -32768)])
def test_the_least_normalised_integer_is_no_less_than_minus_one(
    tmp_path: Path, component: int, letter: str, least: int
) -> None:
    """glTF 2.0, 3.6.2.2: f = max(c / 127, −1.0). A red of SH degree 0 shows it."""

    def change(document: dict[str, Any]) -> None:
        data = struct.pack(f"<6{letter}", least, least + 1, 0, 0, 0, 0)
        document["bufferViews"].append({"buffer": 1, "byteLength": len(data)})
        document["buffers"].append({"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()})
        accessor = {"bufferView": 1, "componentType": component, "count": 2, "type": "VEC3", "normalized": True}
        document["accessors"][4] = accessor

    by_hand(tmp_path / "a.gltf", change)
    np.testing.assert_array_equal(load_gaussians(tmp_path / "a.gltf").sh[0, 0], [-1, -1, 0])


def test_a_node_s_matrix_is_column_by_column_and_its_children_follow(tmp_path: Path) -> None:
    """A quarter turn about z that doubles: (x, y, z) becomes (−2y, 2x, 2z), then 5 along y; below it 1 along x."""

    def change(document: dict[str, Any]) -> None:
        document["nodes"] = [
            {"matrix": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 0, 5, 0, 1], "children": [1]},
            {"translation": [1, 0, 0], "mesh": 0},
        ]

    by_hand(tmp_path / "a.gltf", change)
    read = load_gaussians(tmp_path / "a.gltf")
    wanted = [[-2 * y, 2 * (x + 1) + 5, 2 * z] for x, y, z in ((1, 2, 3), (4, 5, 6))]
    np.testing.assert_allclose(read.means * TURN, wanted, rtol=1e-6)
    np.testing.assert_allclose(read.scales[0], 2 * np.array([51, 102, 255]) / 255, rtol=1e-6)


def outside(document: dict[str, Any]) -> None:
    document["buffers"][0]["uri"] = "../secret.bin"


def endless_name(document: dict[str, Any]) -> None:
    document["buffers"][0]["uri"] = "x" * 5000


def network(document: dict[str, Any]) -> None:
    document["buffers"][0]["uri"] = "https://example.org/a.bin"


def many(document: dict[str, Any]) -> None:
    document["accessors"][0]["count"] = 1 << 31


def one_byte_beyond_its_view(document: dict[str, Any]) -> None:
    document["bufferViews"][0]["byteLength"] -= 1


def one_byte_beyond_its_buffer(document: dict[str, Any]) -> None:
    document["bufferViews"][0]["byteOffset"] = 1


def unequal(document: dict[str, Any]) -> None:
    document["accessors"][3]["count"] = 1


def stretched(document: dict[str, Any]) -> None:
    document["nodes"][1]["scale"] = [1, 2, 1]


def endless(document: dict[str, Any]) -> None:
    document["nodes"][1]["children"] = [0]


def compressed(document: dict[str, Any]) -> None:
    extension = document["meshes"][0]["primitives"][0]["extensions"][PREFIX]
    extension["extensions"] = {"KHR_gaussian_splatting_compression_other": {"bufferView": 0}}


def no_spz(document: dict[str, Any]) -> None:
    extension = document["meshes"][0]["primitives"][0]["extensions"][PREFIX]
    extension["extensions"] = {SPZ: {"bufferView": 0}}


def nowhere(document: dict[str, Any]) -> None:
    extension = document["meshes"][0]["primitives"][0]["extensions"][PREFIX]
    extension["extensions"] = {SPZ: {"bufferView": 7}}


def many_times(document: dict[str, Any]) -> None:
    document["nodes"][0]["children"] = [1] * 9000


def plain(document: dict[str, Any]) -> None:
    del document["meshes"][0]["primitives"][0]["extensions"]


def negative(document: dict[str, Any]) -> None:
    document["bufferViews"][0]["byteOffset"] = -8


def partial(document: dict[str, Any]) -> None:
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    attributes[f"{PREFIX}:SH_DEGREE_1_COEF_0"] = 4


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (outside, "folder"), (endless_name, "folder"), (network, "folder"),
        (many, "too short"), (one_byte_beyond_its_view, "SH_DEGREE_0_COEF_0.*too short"),
        (one_byte_beyond_its_buffer, "beyond its buffer"), (unequal, "beside 2 positions"),
        (stretched, "uniform scale"), (endless, "no end"), (compressed, "compressed by"),
        (no_spz, "damaged gzip stream"), (nowhere, r"no bufferViews\[7\]"),
        (many_times, "more Gaussians than 1000000 bytes"), (plain, "no primitive"),
        (negative, "damaged"), (partial, "SH_DEGREE_1_COEF_1"),
    ],
)  # fmt: skip
def test_what_a_file_may_not_say_is_refused_by_name(tmp_path: Path, change: Any, words: str) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(1000))
    by_hand(tmp_path / "in" / "bad.gltf", change)
    with pytest.raises(InputError, match=words) as caught:
        load_gaussians(tmp_path / "in" / "bad.gltf", max_bytes=10**6)
    assert "bad.gltf" in str(caught.value)


def test_what_is_lost_is_said(tmp_path: Path) -> None:
    camera = Camera(np.array([[10.0, 0, 6], [0, 10, 4], [0, 0, 1]]), np.eye(4), 8, 8)
    made = make_gaussians(views=1, height=8, width=8, degree=4).with_cameras([camera])
    assert save_gaussians(tmp_path / "a.glb", made) == [
        f"SH of degree 4 cut to 3, the highest of {PREFIX}",
        "1 cameras look beside the middle of their picture: kept in extras alone",
    ]
    assert load_gaussians(tmp_path / "a.glb").degree == 3


@pytest.mark.parametrize(("at", "value"), [(4, 3), (8, None), (12, None), (16, 0x004E4942)])
def test_each_number_of_a_binary_file_s_header_is_checked(tmp_path: Path, at: int, value: int | None) -> None:
    """Version, bytes in all, bytes of JSON and kind of the first chunk; the lengths one too many."""
    path = tmp_path / "g.glb"
    save_gaussians(path, make_gaussians(1, 4, 5))
    data = bytearray(path.read_bytes())
    most = {8: len(data), 12: len(data) - 20}
    if value is None:
        struct.pack_into("<I", data, at, most[at] + 1)
    else:
        struct.pack_into("<I", data, at, value)
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"damaged \.glb header"):
        load_gaussians(path)
