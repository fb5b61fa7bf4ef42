"""What engines are given by the adapters: their own packages are stood in for by what notes down how it is called."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from page.scripts import ask
from scenes import tells

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian.sh import C0

WEB = Path(ts.__file__).parent / "web"
COUNT = 5

NOTED = """
const told = [], plain = (_, value) => (ArrayBuffer.isView(value) ? [...value] : value instanceof ArrayBuffer ?
  [...new Uint8Array(value)] : value);
const place = () => ({ rotation: {}, scaling: {}, position: { set: (...at) => told.push(["at", ...at]) } });
const decode = async (bytes) => { told.push(["decode", bytes]); return SCENE; };
const answers = { "a": { ok: true, arrayBuffer: async () => "bytes" }, "b": { ok: false, status: 404 } };
const fetch = async (url, options) => { told.push(["fetch", url, options]); return answers[url]; };
"""


def scene(degree: int) -> dict[str, NDArray]:
    rng = np.random.default_rng(degree)
    sh = rng.normal(0, 0.4, (COUNT, (degree + 1) ** 2, 3))
    sh[1, -1] = [0, -1e-6, 3.0]
    sh[2, -1] = [-0.25, 0.5, 1.0]
    sh[3, -1] = [70000, -5, 0.1]
    quats = rng.normal(size=(COUNT, 4))
    made = {
        "means": rng.normal(size=(COUNT, 3)),
        "quats": quats / np.linalg.norm(quats, axis=1, keepdims=True),
        "scales": rng.uniform(0.01, 0.5, (COUNT, 3)),
        "opacities": np.array([0, 0.2, 0.5, 0.999, 1]),
        "sh": sh,
    }
    return {name: array.astype(np.float32) for name, array in made.items()}


def adapter(name: str, given: dict[str, NDArray], stubs: str, call: str) -> Any:
    """What `call` gives, in the adapter's module, whose imports are `stubs` instead."""
    degree = int(given["sh"].shape[1] ** 0.5) - 1
    text = re.sub(r"^import .*?;$", "", (WEB / "adapters" / name).read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    arrays = ", ".join(f"{key}: Float32Array.from({value.ravel().tolist()})" for key, value in given.items())
    made = f"const SCENE = {{ count: {COUNT}, degree: {degree}, origin: [7, -8, 9], {arrays} }};"
    text = re.sub(r"^export ", "", text, flags=re.MULTILINE)
    body = f"{made}\n{NOTED}\n{stubs}\n{text}\nexport default await (async () => {{ {call} }})();"
    return ask(
        body.replace("export default await", "const value = await")
        + "\nexport default JSON.parse(JSON.stringify(value, plain));"
    )


def named(told: list[Any], name: str) -> NDArray:
    return np.array([one[1:] for one in told if one[0] == name], float)


THREE = """
const SH_BAND_COMPONENTS = [0, 9, 15, 21];
const note = (name) => (array, ...given) => { told.push([name, ...given]); };
const [writeCovariance, writeColorBytesFromSH0] = ["covariance", "color"].map(note);
const createPackedSphericalHarmonicsBand = (count, band) => {
  const bytes = new Uint8ClampedArray(count * [0, 12, 16, 24][band]);
  return { bytes, packed: [band, bytes] };
};
const createGaussianSplatGeometry = (means, covariances, colors, packed) => ({ means, sizes: [covariances.length,
  colors.length], packed });
class GaussianSplat { constructor(geometry) { Object.assign(this, place(), { geometry }); } }
"""


@pytest.mark.parametrize("degree", [0, 2, 4])
def test_three_gets_covariances_colours_and_bands(degree: int) -> None:
    given = scene(degree)
    made, told = adapter("three.js", given, THREE, "return [splatsOf(SCENE), told]")
    i = np.arange(COUNT)[:, None]
    xyzw = given["quats"][:, [1, 2, 3, 0]]
    np.testing.assert_allclose(named(told, "covariance"), np.hstack([6 * i, given["scales"], xyzw]), rtol=1e-6)
    np.testing.assert_allclose(
        named(told, "color"), np.hstack([4 * i, given["sh"][:, 0], given["opacities"][:, None]]), rtol=1e-6
    )
    geometry = made["geometry"]
    np.testing.assert_allclose(geometry["means"], given["means"].ravel(), rtol=1e-6)
    assert geometry["sizes"] == [6 * COUNT, 4 * COUNT] and list(geometry["packed"]) == [
        f"sh{n}" for n in range(1, min(degree, 3) + 1)
    ]
    for n, (band, data) in enumerate(geometry["packed"].values(), 1):
        rows = np.reshape([data[str(j)] for j in range(len(data))] if isinstance(data, dict) else data, (COUNT, -1))
        own = given["sh"][:, n**2 : (n + 1) ** 2].reshape(COUNT, -1).astype(float)
        assert band == n and not rows[:, own.shape[1] :].any()
        np.testing.assert_array_equal(rows[:, : own.shape[1]], np.clip(np.rint(128 * own + 128), 0, 255))
    assert made["rotation"]["x"] == np.pi and told[-1] == ["at", 7, 8, -9]


SPARK = """
const utils = {
  getTextureSize: (count) => ({ maxSplats: count + 3 }),
  encodeExtSplat: (arrays, ...given) => { told.push(["splat", arrays.length, arrays[1].length, ...given]); },
};
class ExtSplats { constructor(given) { Object.assign(this, given); } }
class SplatMesh { constructor(given) { Object.assign(this, place(), given); } }
"""


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4])
def test_spark_gets_splats_and_coefficients_of_a_common_exponent(degree: int) -> None:
    given = scene(degree)
    made, told = adapter("spark.js", given, SPARK, "return [splatsOf(SCENE), told]")
    xyzw, color = given["quats"][:, [1, 2, 3, 0]], 0.5 + C0 * given["sh"][:, 0]
    fixed = np.tile([2, 4 * (COUNT + 3)], (COUNT, 1))
    wanted = np.hstack(
        [fixed, np.arange(COUNT)[:, None], given["means"], given["scales"], xyzw, given["opacities"][:, None], color]
    )
    np.testing.assert_allclose(named(told, "splat"), wanted, rtol=1e-6)
    extra, names = made["splats"]["extra"], ["sh1", "sh2", "sh3a", "sh3b"][: (0, 1, 2, 4, 4)[degree]]
    assert list(extra) == names and made["splats"]["numSplats"] == COUNT
    assert made["rotation"]["x"] == np.pi and told[-1] == ["at", 7, 8, -9]
    if not degree:
        return
    functions = min((degree + 1) ** 2, 16) - 1
    words = np.array([extra[name] for name in names], np.uint32).reshape(len(extra), -1, 4)
    words = words[:, :COUNT].transpose(1, 0, 2).reshape(COUNT, -1)
    assert not words[:, functions:].any()
    values = given["sh"][:, 1 : functions + 1].astype(float)
    exponent = np.ceil(np.log2(np.maximum(np.abs(values).max(-1), 2.0**-15)))
    base = np.minimum(exponent + 15, 31)
    sizes = np.minimum(np.floor(np.abs(values) * 255 / 2.0 ** (base[..., None] - 15) + 0.5), 255)
    packed = sum(sizes[..., k] * 2 ** (8 * k) + (values[..., k] < 0) * 2 ** (24 + k) for k in range(3))
    np.testing.assert_array_equal(words[:, :functions], packed + base * 2**27)


@pytest.mark.parametrize(("name", "stubs"), [("spark.js", SPARK), ("three.js", THREE)])
def test_addresses_are_fetched_and_decoded(name: str, stubs: str) -> None:
    call = """
    const signal = "stop", made = await loadTsplat("a", { signal }), plainly = await loadTsplat("a");
    const refused = await loadTsplat("b").catch((error) => error.message);
    return [told.filter(([name]) => name === "fetch" || name === "decode"), made.rotation.x, refused];
    """
    told, turned, refused = adapter(name, scene(0), stubs, call)
    assert told == [
        ["fetch", "a", {"signal": "stop"}],
        ["decode", "bytes"],
        ["fetch", "a", {}],
        ["decode", "bytes"],
        ["fetch", "b", {}],
    ]
    assert turned == np.pi and tells(refused, "b 404")


BABYLON = """
class GaussianSplattingMesh {
  constructor(name, url, scene) { Object.assign(this, place(), { given: [name, url, scene.name] }); }
  updateData(...given) { this.data = given; }
}
class AssetContainer { constructor() { this.meshes = []; } removeAllFromScene() { told.push(["removed"]); } }
const engine = { name: "scene", getEngine: () => ({ getCaps: () => ({ maxTextureSize: 4 }) }) };
"""


@pytest.mark.parametrize("degree", [0, 1, 3, 4])
def test_babylon_gets_rows_and_textures_of_coefficients(degree: int) -> None:
    given = scene(degree)
    call = """
    const left = await new TsplatLoader().importMeshAsync(null, engine, "file"),
      right = await new TsplatLoader().importMeshAsync(null, { ...engine, useRightHandedSystem: true });
    const container = await new TsplatLoader().loadAssetContainerAsync(engine, "file");
    return [left, right, container.meshes.length, told, new TsplatLoader()];
    """
    left, right, count, told, loader = adapter("babylon.js", given, BABYLON, call)
    mesh = left.pop("meshes")[0]
    assert mesh["given"][1:] == [None, "scene"] and set(map(str, left.values())) == {"[]"} and count == 1
    rows, textures, *rest = mesh["data"]
    assert rest == [{"flipY": False}, None, degree]
    rows = np.array(rows, np.uint8).reshape(COUNT, 32)
    np.testing.assert_array_equal(rows[:, :24].copy().view(np.float32), np.hstack([given["means"], given["scales"]]))
    tail = np.hstack(
        [
            255 * (0.5 + C0 * given["sh"][:, 0].astype(float)),
            255 * given["opacities"][:, None].astype(float),
            127.5 + 127.5 * given["quats"].astype(float),
        ]
    )
    np.testing.assert_array_equal(rows[:, 24:], np.clip(np.rint(tail), 0, 255))
    numbers = given["sh"][:, 1:].reshape(COUNT, -1).astype(float)
    assert len(textures) == -(-numbers.shape[1] // 16)
    for n, texture in enumerate(textures):
        texture = np.reshape(list(texture.values()) if isinstance(texture, dict) else texture, (8, 16))
        own = numbers[:, 16 * n : 16 * n + 16]
        np.testing.assert_array_equal(texture[:COUNT, : own.shape[1]], np.clip(np.rint(127.5 + 127.5 * own), 0, 255))
        assert not texture[COUNT:].any() and not texture[:COUNT, own.shape[1] :].any()
    assert mesh["scaling"] == {"y": -1} and mesh["rotation"] == {}
    assert right["meshes"][0]["rotation"] == {"x": np.pi} and right["meshes"][0]["scaling"] == {}
    places = [one for one in told if one[0] == "at"]
    assert places == [["at", 7, 8, 9], ["at", 7, 8, -9], ["at", 7, 8, 9]] and told[-1] == ["removed"]
    assert loader == {"name": "tsplat", "extensions": {".tsplat": {"isBinary": True}}}
