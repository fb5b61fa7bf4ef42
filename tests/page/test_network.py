"""What the page feeds a network with and makes of its outputs, beside graphs/predict.py."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from page.scripts import run as run_with
from scenes import make_cameras

import tinysplat_runtime as ts
from tinysplat_runtime.container.cameras import intrinsics
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.graphs.inference import Graph
from tinysplat_runtime.graphs.predict import NetworkLimits, network_inputs, predict

NEAR, FAR = 1.5, 9.0


def run(call: str, **given: Any) -> Any:
    code = f"""
    for (const tensor of Object.values(outputs)) tensor.data = Float32Array.from(tensor.data);
    return JSON.parse(JSON.stringify({call}, (_, value) => (ArrayBuffer.isView(value) ? [...value] : value)));
    """
    return run_with(code, 'import { networkInputs, predictionOf } from "./network.js";', **{"outputs": {}, **given})


def asked(images: NDArray, cameras: tuple[ts.Camera, ...]) -> dict[str, Any]:
    width, height = cameras[0].width, cameras[0].height
    names = ("fx", "fy", "cx", "cy", "skew")
    views = [
        {
            "width": width,
            "height": height,
            **dict(zip(names, map(float, intrinsics(one.K)), strict=True)),
            "c2w": one.c2w.ravel().tolist(),
        }
        for one in cameras
    ]
    photos = [image.ravel().tolist() for image in images]
    return {"photos": photos, "width": width, "height": height, "near": NEAR, "far": FAR, "cameras": views}


def placed(cameras: Iterable[ts.Camera], away: tuple[float, float, float]) -> list[ts.Camera]:
    """Elsewhere, and with sensors that are not quite rectangular."""
    found = []
    for n, camera in enumerate(cameras):
        K, c2w = np.array(camera.K), np.array(camera.c2w)
        K += np.array([[n, 0.75 - n, 3 * n], [0, 2 * n, n / 2], [0, 0, 0]])
        c2w[:3, 3] += away
        found.append(ts.Camera(K, c2w, camera.width, camera.height))
    return found


@pytest.mark.parametrize(("height", "width"), [(18, 22), (32, 48), (50, 66)])
def test_inputs_are_the_host_s(height: int, width: int) -> None:
    cameras = placed(make_cameras(3, height, width), (3, -2, 1))
    images = np.random.default_rng(1).random((3, height, width, 3)).astype(np.float32)
    expected = network_inputs(images, cameras, NEAR, FAR, NetworkLimits(stride=16, min_side=40))
    found = run("networkInputs(request, { stride: 16, minSide: 40 })", request=asked(images, tuple(cameras)))
    assert set(found) == set(expected)
    for name, array in expected.items():
        data, shape = found[name]
        assert tuple(shape) == array.shape
        np.testing.assert_allclose(np.array(data).reshape(shape), array, atol=1e-6)


@pytest.mark.parametrize(
    "away", [(0, 0, 0), (90, -50, 30), (150, 80, -60), (160, 80, 80), (1e4, 0, 0), (0, 1e4, 0), (0, 0, 1e4)]
)
def test_outputs_become_the_host_s_gaussians(away: tuple[float, float, float]) -> None:
    rng, cameras = np.random.default_rng(2), placed(make_cameras(2, 18, 22), away)
    if away == (160, 80, 80):  # one that is far is enough
        cameras[0] = make_cameras(1, 18, 22)[0]
    outputs: dict[str, NDArray] = {"layer1_K": np.stack([camera.K for camera in cameras]).astype(np.float32)}
    for prefix, rows, columns in (("", 32, 32), ("layer1_", 10, 12)):
        for name, trailing in FIELDS.items():
            rest = (1, 3) if name == "sh" else trailing
            outputs[prefix + name] = rng.uniform(0, 1.2, (2, rows, columns, *rest)).astype(np.float32)
        outputs[prefix + "opacities"][0, 0, 0] = 1.1
    images = np.zeros((2, 18, 22, 3), np.float32)

    class Given(Graph):
        def run(self, *_: object) -> dict[str, NDArray]:  # type: ignore[override]
            return outputs

    expected = predict(images, cameras, NEAR, FAR, Given("given", None))
    tensors = {name: {"data": array.reshape(-1).tolist(), "dims": array.shape} for name, array in outputs.items()}
    found = run("predictionOf(outputs, request)", request=asked(images, tuple(cameras)), outputs=tensors)
    np.testing.assert_allclose(found["origin"], expected.origin)
    for layer, wanted in zip(found["layers"], expected.layers, strict=True):
        for name in FIELDS:
            array = getattr(wanted, name)
            np.testing.assert_allclose(np.array(layer[name]).reshape(array.shape), array, rtol=1e-6)
        for camera, its in zip(layer["cameras"], wanted.cameras, strict=True):
            np.testing.assert_allclose(
                [camera[name] for name in ("fx", "fy", "cx", "cy", "skew")], intrinsics(its.K), rtol=1e-6
            )
        assert (layer["height"], layer["width"]) == (wanted.cameras[0].height, wanted.cameras[0].width)


RUNTIME = """
export const env = { wasm: {} };
export class Tensor { constructor(...given) { this.given = given; } }
export const InferenceSession = { create: async (address) => {
  told.push([address, env.wasm.wasmPaths.wasm]);
  return { run: async (inputs) => {
    told.push(Object.entries(inputs).map(([name, { given: [type, data, dims] }]) => [name, type, data.length, dims]));
    return outputs;
  } };
} };
"""


def test_networks_beside_the_page_are_loaded_once_and_only_as_known() -> None:
    camera = asked(np.zeros((1, 2, 3, 3)), tuple(make_cameras(1, 2, 3)))
    made, told, refused = run_with(
        """
        Object.assign(globalThis, { told: [], location: { href: "https://example.org/a/page.html" } });
        const sizes = { means: [3], quats: [4], scales: [3], opacities: [], sh: [1, 3] };
        globalThis.outputs = Object.fromEntries(Object.entries(sizes).map(([name, rest]) => {
          const dims = [1, 4, 4, ...rest];
          return [name, { dims, data: new Float32Array(dims.reduce((a, b) => a * b)).fill(0.5) }];
        }));
        const models = { one: { file: "one.onnx", stride: 4, minSide: 4 }, two: { file: "two.onnx", stride: 4,
          minSide: 4 } };
        const runner = networkRunner({ runtime: `data:text/javascript,${encodeURIComponent(text)}`, wasm: "ort.wasm",
          most: 6, models });
        const first = await runner({ ...camera, sha256: "one" });
        for (const sha256 of ["one", "two"]) await runner({ ...camera, sha256 });
        const refused = [];
        const ask = async (more) => runner({ ...camera, sha256: "one",
          ...more }).catch((error) => refused.push(error.message));
        await ask({ sha256: "three", name: "edge" });
        await ask({ width: 7, height: 1 });
        globalThis.outputs.scales.data[5] = NaN;
        await ask({});
        const { layers: [{ height, width, degree, means }], origin } = first;
        return [[height, width, degree, means.length, origin], told, refused];
        """,
        'import { networkRunner } from "./network.js";',
        camera=camera,
        text=RUNTIME,
    )
    assert made == [2, 3, 0, 18, [0, 0, 0]]
    loads = [one[0] for one in told if isinstance(one[0], str)]
    assert [loads[0], loads.count("https://example.org/a/two.onnx")] == ["https://example.org/a/one.onnx", 1]
    shapes = {"images": [1, 3, 4, 4], "K": [1, 3, 3], "c2w": [1, 4, 4], "near": [1], "far": [1]}
    for fed in told[1:3]:  # loaded once for both
        assert {name: rest for name, *rest in fed} == {n: ["float32", math.prod(s), s] for n, s in shapes.items()}
    assert len(refused) == 3 and "edge" in refused[0] and "7x1" in refused[1]
