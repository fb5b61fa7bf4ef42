"""glTF by hand: what its fields may be, and which nodes are shown."""

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import refused, tells

from tinysplat_runtime.errors import InputWarning
from tinysplat_runtime.formats.gltf_reader import srgb_of_linear
from tinysplat_runtime.formats.table import load_gaussians
from tinysplat_runtime.gaussian.sh import sh_basis

TURN = np.array([1.0, -1.0, -1.0])  # glTF has y up and z backward
PREFIX = "KHR_gaussian_splatting"
SPZ = "KHR_gaussian_splatting_compression_spz_2"
TYPES = {5120: "b", 5121: "B", 5122: "h", 5123: "H", 5126: "f"}


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


def test_photos_cameras_stand_where_their_nodes_put_them_and_other_cameras_are_not_taken(tmp_path: Path) -> None:
    photo = {"K": [[9, 0, 6], [0, 9, 4], [0, 0, 1]], "width": 12, "height": 8}

    def change(document: dict[str, Any]) -> None:
        lens = {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}
        odd = [{**lens, "extras": {**photo, **more}} for more in ({"K": "wide"}, {"K": [[10**400]]}, {"width": -1})]
        document["cameras"] = [{**lens, "extras": photo}, lens, *odd]
        document["nodes"] += [{"camera": number, "translation": [1, 2, 3]} for number in range(5)]
        document["nodes"][1]["children"] = [2, 3, 4, 5, 6]

    by_hand(tmp_path / "a.gltf", change)
    (camera,) = load_gaussians(tmp_path / "a.gltf").viewpoints
    np.testing.assert_allclose(camera.c2w[:3], np.column_stack([np.eye(3), np.array([2, 4, 16]) * TURN]))
    assert camera.K.tolist() == photo["K"] and (camera.width, camera.height) == (12, 8)


def stating(**fields: Any) -> Any:
    """What changes the extension's fields in a document."""
    return lambda document: document["meshes"][0]["primitives"][0]["extensions"][PREFIX].update(fields)


def test_linear_colours_become_those_of_srgb(tmp_path: Path) -> None:
    linear = np.array([0.5 + 0.28209479 * value for value in (0.1, 0.2, 0.3)])
    by_hand(tmp_path / "a.gltf", stating(colorSpace="lin_rec709_display"))
    with pytest.warns(InputWarning, match="lin_rec709_display"):
        read = load_gaussians(tmp_path / "a.gltf")
    np.testing.assert_allclose(0.5 + 0.28209479 * read.sh[0, 0], 1.055 * linear ** (1 / 2.4) - 0.055, rtol=1e-6)


def test_linear_colours_that_change_with_direction_are_fitted() -> None:
    rng = np.random.default_rng(0)
    sh = np.concatenate([rng.uniform(-1, 1.5, (50, 1, 3)), rng.normal(0, 0.05, (50, 15, 3))], axis=1)
    rays = rng.normal(size=(200, 3))
    basis = sh_basis(rays / np.linalg.norm(rays, axis=1, keepdims=True), 3)
    linear = (0.5 + basis @ sh).clip(0.0031308)
    wanted = 1.055 * linear ** (1 / 2.4) - 0.055
    assert np.sqrt(((0.5 + basis @ srgb_of_linear(sh) - wanted) ** 2).mean()) < 0.01


@pytest.mark.parametrize(
    ("field", "value"),
    [("kernel", "box"), ("colorSpace", "bt2020_pq"), ("projection", "orthographic"), ("sortingMethod", ["none"])],
)
def test_other_kernels_spaces_projections_and_orders_are_refused_by_name(
    tmp_path: Path, field: str, value: Any
) -> None:
    by_hand(tmp_path / "a.gltf", stating(**{field: value}))
    assert tells(refused(load_gaussians, tmp_path / "a.gltf"), f"{PREFIX}.{field} {value!r}")


@pytest.mark.parametrize(
    ("required", "is_fine"),
    [(["KHR_mesh_quantization", "KHR_materials_unlit"], True), (["EXT_strange"], False), ([3], False), ("x", False)],
)
def test_extensions_that_a_file_requires_are_known_or_refused(tmp_path: Path, required: Any, is_fine: bool) -> None:
    by_hand(tmp_path / "a.gltf", lambda document: document.update(extensionsRequired=required))
    if is_fine:
        assert load_gaussians(tmp_path / "a.gltf").count == 2
    else:
        assert tells(refused(load_gaussians, tmp_path / "a.gltf"), f"extensionsRequired {required[0]!r}")


@pytest.mark.parametrize("component", [5120, 5121, 5122, 5123, 5125, 5126])
@pytest.mark.parametrize("normalised", [True, False])
def test_every_type_of_number_is_read_as_the_specification_has_it(
    tmp_path: Path, component: int, normalised: bool
) -> None:
    """Normalised integers are value / largest, and at least −1; opacities here, whose stored number is known."""
    letter, largest = {
        **{k: (v, 2 ** (8 * struct.calcsize(v) - v.islower()) - 1) for k, v in TYPES.items()},
        5125: ("I", 2**32 - 1),
        5126: ("f", 1),
    }[component]
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


BAD = [
    (lambda d: d.update(accessors={}), "no accessors[0]"),
    (lambda d: d["accessors"].__setitem__(1, 7), "accessors[1]: no object"),
    (lambda d: d.update(meshes=[]), "no meshes[0]"), (lambda d: d["nodes"][1].update(mesh=True), "no meshes[True]"),
    (lambda d: d["accessors"][0].update(componentType=5124), "POSITION"),
    (lambda d: d["accessors"][0].update(sparse={}), "POSITION"),
    (lambda d: d["bufferViews"][0].update(byteStride=11), "POSITION"),
    (lambda d: d["bufferViews"][0].update(byteLength=1 << 40), "POSITION"),
    (lambda d: d["bufferViews"][0].update(extensions={"EXT_x": 1}),
     "POSITION: 'EXT_x'"),
    (lambda d: d["buffers"][0].pop("uri"), ""),
    (lambda d: d["buffers"][0].update(uri="data:;base64,???"), "base64"),
    (lambda d: d["buffers"][0].update(uri="a%00b"), "buffer 'a%00b'"),
    (lambda d: d["buffers"][0].update(uri="%2e%2e/x"), ""),
    (lambda d: d.update(nodes=[{}] * 200_000), "200000"),
    (lambda d: d["meshes"][0]["primitives"][0]["attributes"].pop("POSITION"), "lacks POSITION"),
    (lambda d: d["accessors"][0].update(type="VEC2"), "POSITION: (2, 2)"),
    (lambda d: d["buffers"][0].update(uri="../secret.bin"), ""),
    (lambda d: d["accessors"][0].update(count=1 << 31), "POSITION"),
    (lambda d: d["bufferViews"][0].update(byteLength=79), "SH_DEGREE_0_COEF_0"),
    (lambda d: d["accessors"][3].update(count=1), "2"),
    (lambda d: d["nodes"][1].update(scale=[1, 2, 1]), ""),
    (lambda d: d["nodes"][1].update(children=[0]), ""),
    (lambda d: d["nodes"][0].update(children=[1] * 9000), "1000000"),
    (lambda d: d["meshes"][0]["primitives"][0].pop("extensions"), ""),
    (lambda d: d["meshes"][0]["primitives"][0]["attributes"].update({f"{PREFIX}:SH_DEGREE_1_COEF_0": 4}),
     "SH_DEGREE_1_COEF_1"),
    (lambda d: d["meshes"][0]["primitives"][0]["extensions"][PREFIX].update(extensions={SPZ: {"bufferView": 0}}),
     ""),
    (lambda d: d["meshes"][0]["primitives"][0]["extensions"][PREFIX].update(extensions={SPZ: {"bufferView": 7}}),
     "no bufferViews[7]"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "words"), BAD)
def test_fields_that_do_not_fit_are_refused_by_name(tmp_path: Path, change: Any, words: str) -> None:
    by_hand(tmp_path / "hand.gltf", change)
    assert tells(refused(load_gaussians, tmp_path / "hand.gltf", max_bytes=10**6), words)


def chain(depth: int, last: dict[str, Any]) -> Any:
    """So many nodes, each the child of the one before, and a last one."""

    def change(document: dict[str, Any]) -> None:
        document["nodes"] = [{"children": [n + 1]} for n in range(depth)] + [last]

    return change


def test_nodes_may_be_nested_but_not_without_end(tmp_path: Path) -> None:
    by_hand(tmp_path / "a.gltf", chain(8, {"mesh": 0}))
    assert load_gaussians(tmp_path / "a.gltf").count == 2
    for ancestor in (0, 1):
        by_hand(tmp_path / "a.gltf", chain(1, {"mesh": 0, "children": [ancestor]}))
        refused(load_gaussians, tmp_path / "a.gltf")


def test_visible_roots_of_the_scene_are_shown_or_all_nodes_where_there_is_no_scene(tmp_path: Path) -> None:
    def shown(**fields: Any) -> list[float]:
        def change(document: dict[str, Any]) -> None:
            document["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 100]}, {"children": [1]}]
            document["scenes"] = [{"nodes": [0]}, {"nodes": [2, 0]}]
            document.update(fields)

        by_hand(tmp_path / "a.gltf", change)
        return sorted(-load_gaussians(tmp_path / "a.gltf").means[:, 2])

    assert shown() == [3, 6] and shown(scene=1) == [3, 6, 103, 106]
    assert shown(scenes=None) == [3, 6, 103, 103, 106, 106]
    hidden = {"children": [1], "extensions": {"KHR_node_visibility": {"visible": False}}}
    nodes = [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 100]}, hidden]
    assert shown(scene=1, nodes=nodes, extensionsRequired=["KHR_node_visibility"]) == [3, 6]


@pytest.mark.parametrize(
    ("asset", "expected"),
    [
        ({"extras": {"unit": "m", "x": 1}, "copyright": "us"}, {"unit": "m"}),
        ({"copyright": "us"}, {"attribution": "us"}),
        ({"copyright": 7}, {}),
        ([], {}),
        ({"extras": []}, {}),
    ],
)
def test_notes_stand_in_the_asset(tmp_path: Path, asset: Any, expected: dict[str, str]) -> None:
    by_hand(tmp_path / "a.gltf", lambda document: document.update(asset=asset))
    assert load_gaussians(tmp_path / "a.gltf").notes.given() == expected


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"glTF" + bytes(15), ""),
        (b"{", "JSON"),
        (b"[]", "JSON"),
        (b"glTF" + struct.pack("<4I", 2, 22, 2, 0x4E4F534A) + b"{}", ""),
        (b"glTF" + struct.pack("<4I", 2, 23, 2, 0x4E4F534A) + b"{}", ".glb 2 23 22"),
        (b"glTF" + struct.pack("<4I", 2, 22, 3, 0x4E4F534A) + b"{}", ".glb 2 22 22"),
        (b"glTF" + struct.pack("<4I", 1, 22, 2, 0x4E4F534A) + b"{}", ".glb 1 22 22"),
        (b"glTF" + struct.pack("<4I", 2, 22, 2, 7) + b"{}", ".glb 2 22 22"),
    ],
)
def test_files_that_are_no_gltf_are_refused(tmp_path: Path, data: bytes, words: str) -> None:
    (tmp_path / "a.glb").write_bytes(data)
    assert tells(refused(load_gaussians, tmp_path / "a.glb"), words)


@pytest.mark.parametrize(
    ("kind", "length", "is_fine"), [(0x004E4942, 0, True), (0x004E4943, 0, False), (0x004E4942, 1, False)]
)
def test_a_binary_chunk_is_whole(tmp_path: Path, kind: int, length: int, is_fine: bool) -> None:
    by_hand(tmp_path / "a.gltf")
    document = json.loads((tmp_path / "a.gltf").read_text())
    data = base64.b64decode(document["buffers"][0].pop("uri").partition(",")[2])
    text = json.dumps(document).encode()
    body = text + struct.pack("<2I", len(data) + length, kind) + data
    (tmp_path / "a.glb").write_bytes(b"glTF" + struct.pack("<4I", 2, 20 + len(body), len(text), 0x4E4F534A) + body)
    if is_fine:
        assert load_gaussians(tmp_path / "a.glb").count == 2
    else:
        refused(load_gaussians, tmp_path / "a.glb")
