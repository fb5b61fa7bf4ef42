"""The shipped graph of `sweep` against its torch twin: every number of views, several sizes, inputs without texture."""

import numpy as np
import pytest
import torch
from networks.two_planes import network_inputs, trace

from tinysplat.networks.sweep import MAX_VIEWS, MIN_SIDE, MIN_VIEWS, OUTPUT_NAMES, STRIDE, Sweep
from tinysplat_runtime.graphs.inference import GraphStore

STORE = GraphStore(threads=1)

RTOL = 1e-3  # of an output's largest magnitude; of two Gaussians at one depth rounding decides which hides the other
SHARE = 0.995  # of the values: where two candidates cost the same, rounding decides which is taken

SIZES = [(2, 64, 96), (3, 64, 96), (6, 64, 96), (2, 92, 48), (3, 92, 48)]


def assert_same(inputs: dict[str, np.ndarray]) -> None:
    found = STORE.network("sweep").run(inputs)
    with torch.no_grad():
        expected = Sweep()(*(torch.from_numpy(array) for array in inputs.values()))
    assert tuple(found) == OUTPUT_NAMES
    for name, want in zip(OUTPUT_NAMES, expected, strict=True):
        assert found[name].shape == tuple(want.shape), name
        error = np.abs(found[name] - want.numpy()) / max(float(want.abs().max()), 1e-30)
        assert np.quantile(error, SHARE) < RTOL, name


@pytest.mark.parametrize("size", SIZES)
def test_onnx_matches_torch_for_every_number_of_views_and_size(size):
    scene = trace(*size)
    assert_same(network_inputs(scene.images, scene.cameras))


def test_metadata_states_the_limits_of_the_module():
    metadata = STORE.network("sweep").metadata
    assert metadata["role"] == "network" and metadata["licence"] == "Apache-2.0" and metadata["provenance"]
    assert (metadata["min_views"], metadata["max_views"]) == (MIN_VIEWS, MAX_VIEWS)
    assert (metadata["stride"], metadata["min_side"]) == (STRIDE, MIN_SIDE)
    assert set(metadata["inputs"]) == {"images", "K", "c2w", "near", "far"}
