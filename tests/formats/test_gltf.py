"""glTF: what a reader of the specification's words finds in our files, and what we find in files made by hand."""

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from formats.foreign import glb_of_spz
from numpy.typing import NDArray
from scenes import make_gaussians, refusing, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.notes import Notes
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.gaussian.sh import sh_basis
from tinysplat_runtime.scene.cameras import Camera

TURN = np.array([1.0, -1.0, -1.0])  # glTF has y up and z backward
PREFIX = "KHR_gaussian_splatting"
TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}


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


def accessor_of(document: dict[str, Any], name: str) -> dict[str, Any]:
    return document["accessors"][document["meshes"][0]["primitives"][0]["attributes"][name]]


def attribute(document: dict[str, Any], binary: bytes, name: str) -> NDArray:
    accessor = accessor_of(document, name)
    view, kind = document["bufferViews"][accessor["bufferView"]], np.dtype(TYPES[accessor["componentType"]])
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
    values = [
        np.frombuffer(binary, kind, width, view["byteOffset"] + i)
        for i in range(0, view["byteLength"], view["byteLength"] // accessor["count"])
    ]
    return np.array(values) / (np.iinfo(kind).max if accessor.get("normalized") else 1)


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
    accessor = accessor_of(document, "POSITION")
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
    assert all(text in document["asset"]["copyright"] for text in ("Jo Doe", "CC-BY-4.0"))
    fallback = attribute(document, binary, "COLOR_0")
    rgb = (0.5 + 0.28209479177387814 * made.flat().sh[:, 0]).clip(0, 1)
    shown = np.where(
        fallback[:, :3] <= 0.0031308, fallback[:, :3] * 12.92, 1.055 * fallback[:, :3] ** (1 / 2.4) - 0.055
    )
    np.testing.assert_allclose(shown, rgb, atol=0.02)  # a byte's step where it is darkest is 0.012
    node = next(node for node in document["nodes"] if node.get("camera") == 1)
    look = np.array(node["matrix"]).reshape(4, 4).T @ [0, 0, -1, 0]  # glTF cameras look along −z
    np.testing.assert_allclose(look[:3] * TURN, made.cameras[1].c2w[:3, 2], atol=1e-12)
    yfov = document["cameras"][1]["perspective"]["yfov"]
    assert np.tan(yfov / 2) == pytest.approx(made.cameras[1].height / 2 / made.cameras[1].K[1, 1])


def test_far_scenes_keep_their_digits_in_the_nodes_translation(tmp_path: Path) -> None:
    flat = make_gaussians().flat()
    far = Gaussians(flat.means, flat.quats, flat.scales, flat.opacities, flat.sh, origin=np.array([5e5, 4e6, 300.0]))
    save_gaussians(tmp_path / "far.glb", far)
    read = load_gaussians(tmp_path / "far.glb")
    np.testing.assert_allclose(read.means.astype(np.float64) + read.origin, far.means + far.origin, rtol=0, atol=1e-6)


def test_gltf_with_spz_reads_as_the_spz_file_does_where_its_node_puts_it(tmp_path: Path) -> None:
    made, place = make_gaussians(degree=2).with_notes(Notes(antialiased="yes")), (5e5, -4e6, -300.0)
    save_gaussians(tmp_path / "a.spz", made)
    spz = (tmp_path / "a.spz").read_bytes()
    (tmp_path / "a.glb").write_bytes(glb_of_spz(spz, made.count, extras=made.notes.given()))
    (tmp_path / "far.glb").write_bytes(glb_of_spz(spz, made.count, place))
    (tmp_path / "less.glb").write_bytes(glb_of_spz(spz, made.count - 1))
    read, plain, far = (load_gaussians(tmp_path / name) for name in ("a.glb", "a.spz", "far.glb"))
    for name in ("means", "quats", "scales", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(read, name), getattr(plain, name))
    assert read.notes == made.notes
    np.testing.assert_allclose(far.means.astype(np.float64) + far.origin - place * TURN, plain.means, atol=1e-6)
    with refusing(InputError, "POSITION SPZ"):
        load_gaussians(tmp_path / "less.glb")


def test_what_is_lost_is_said(tmp_path: Path) -> None:
    camera = Camera(np.array([[10.0, 0, 6], [0, 10, 4], [0, 0, 1]]), np.eye(4), 8, 8)
    made = replace(make_gaussians(views=1, height=8, width=8, degree=4), cameras=(camera,))
    said = save_gaussians(tmp_path / "a.glb", made)
    assert any(tells(line, f"SH 4 3 {PREFIX}") for line in said) and any("camera" in line for line in said)
    assert load_gaussians(tmp_path / "a.glb").degree == 3
