"""The shipped graph of `edge`: its torch twin, every number of views, and inputs that real life brings."""

import numpy as np
import pytest
import torch
from networks.two_planes import FAR, NEAR, SQUARE_Z, WALL_Z, TracedScene, network_inputs, trace

from tinysplat.networks.edge import MAX_VIEWS, MIN_SIDE, MIN_VIEWS, OPACITY_CAP, OUTPUT_NAMES, STRIDE
from tinysplat.training.state import shipped_network
from tinysplat_runtime.graphs.artifacts import models_dir
from tinysplat_runtime.graphs.inference import GraphStore

STORE = GraphStore(threads=1)

RTOL = 1e-3  # of an output's largest magnitude, for SHARE of the values
SHARE = 0.98  # where two candidates are about as good, rounding decides which is taken

SIZES = [(2, 64, 96), (3, 96, 64), (6, 64, 64)]


def run(images: np.ndarray, cameras, near: float = NEAR, far: float = FAR) -> dict[str, np.ndarray]:
    """Outputs by name, checked to be finite and within the network's bounds."""
    outputs = STORE.network("edge").run(network_inputs(images, cameras, near, far))
    assert all(np.isfinite(array).all() for array in outputs.values())
    assert outputs["opacities"].min() >= 0 and outputs["opacities"].max() <= OPACITY_CAP
    assert outputs["layer1_opacities"].min() >= 0 and outputs["layer1_opacities"].max() <= 1
    assert outputs["depth"].min() >= near * (1 - 1e-4) and outputs["depth"].max() <= far * (1 + 1e-4)
    assert outputs["scales"].min() > 0 and outputs["layer1_scales"].min() > 0
    return outputs


def assert_planes_told_apart(outputs: dict[str, np.ndarray], scene: TracedScene) -> None:
    between = (SQUARE_Z + WALL_Z) / 2
    for plane in (scene.depth < between, scene.depth > between):
        assert np.mean((outputs["depth"] < between) == (scene.depth < between), where=plane) > 0.5


@pytest.mark.parametrize("size", SIZES)
def test_onnx_matches_the_torch_twin_in_float64(size: tuple[int, int, int]) -> None:
    scene = trace(*size)
    inputs = network_inputs(scene.images, scene.cameras)
    found = STORE.network("edge").run(inputs)
    module, steps = shipped_network(models_dir() / "training" / "edge.pt")
    assert steps > 0
    with torch.no_grad():
        expected = module.eval().double()(*(torch.from_numpy(array).double() for array in inputs.values()))
    for name, want in zip(OUTPUT_NAMES, expected, strict=True):
        assert found[name].shape == tuple(want.shape), name
        error = np.abs(found[name] - want.numpy()) / max(float(want.abs().max()), 1e-30)
        assert np.quantile(error, SHARE) < RTOL and error.max() < 10 * RTOL, name


@pytest.mark.parametrize(("near", "far"), [(0.5, 1.0), (1.0, 2.0), (0.5, 2.0)])
def test_a_depth_range_that_is_too_wide_is_forgiven(near: float, far: float) -> None:
    scene = trace(2, 96, 128)
    assert_planes_told_apart(run(scene.images, scene.cameras, near * NEAR, far * FAR), scene)


def test_a_difference_of_exposure_is_survived() -> None:
    scene = trace(2, 96, 128)
    images = scene.images * np.float32([0.7, 1.0])[:, None, None, None]
    assert_planes_told_apart(run(images, scene.cameras), scene)


def test_metadata_states_the_limits_of_the_module() -> None:
    metadata = STORE.network("edge").metadata
    assert metadata["role"] == "network" and metadata["licence"] == "Apache-2.0" and metadata["provenance"]
    assert (metadata["min_views"], metadata["max_views"]) == (MIN_VIEWS, MAX_VIEWS)
    assert (metadata["stride"], metadata["min_side"]) == (STRIDE, MIN_SIDE)
