"""The shipped stages of `edge`: their torch twins, and what a window comes to when its photos go one by one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
import torch
from networks.two_planes import FAR, NEAR, scene_of, trace
from numpy.typing import NDArray

from tinysplat.networks.edge_stages import STAGES, Stage
from tinysplat.training.state import shipped_network
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.graphs.artifacts import models_dir
from tinysplat_runtime.graphs.inference import CONTRACTS, GraphStore
from tinysplat_runtime.network.each import predict_each
from tinysplat_runtime.network.predict import NetworkLimits, predict
from tinysplat_runtime.network.walk import capture_groups
from tinysplat_runtime.scene.cameras import Camera

STORE = GraphStore(threads=1)
SHARE, RTOL = 0.98, 1e-3  # where two candidates are about as good, rounding decides which is taken


@dataclass(frozen=True)
class Twin:
    """A stage in torch and float64, run as a graph is."""

    stage: Stage
    name: str = "twin"
    metadata: Mapping[str, Any] = field(default_factory=lambda: STORE.stages("edge")["glance"].metadata)

    def run(self, inputs: Mapping[str, NDArray]) -> dict[str, NDArray]:
        with torch.no_grad():
            values = self.stage(*(torch.from_numpy(inputs[name]).double() for name in self.stage.inputs))
        found = values if isinstance(values, tuple) else (values,)
        return {name: value.numpy() for name, value in zip(self.stage.outputs, found, strict=True)}


@lru_cache(maxsize=1)
def twins() -> dict[str, Twin]:
    network = shipped_network(models_dir() / "training" / "edge.pt")[0].eval().double()
    return {name: Twin(kind(network)) for name, kind in STAGES.items()}


def one_by_one(images: NDArray, cameras: Sequence[Camera], stages: Mapping[str, Any]) -> Gaussians:
    groups = capture_groups(cameras, NEAR, FAR, NetworkLimits())
    return predict_each(scene_of(images, cameras), stages, groups)


@pytest.mark.parametrize("size", [(7, 64, 96), (3, 80, 48), (2, 64, 64)])
def test_graphs_match_their_twins_in_float64(size: tuple[int, int, int]) -> None:
    scene = trace(*size)
    graphs, twin = (one_by_one(scene.images, scene.cameras, stages) for stages in (STORE.stages("edge"), twins()))
    for found, want in zip(graphs.layers, twin.layers, strict=True):
        for name in FIELDS:
            values, expected = getattr(found, name), getattr(want, name)
            error = np.abs(values - expected) / np.abs(expected).max()
            assert np.quantile(error, SHARE) < RTOL, name


@pytest.mark.parametrize("views", [2, 4])
def test_a_window_comes_to_what_the_network_makes_of_it_at_once(views: int) -> None:
    scene = trace(views, 96, 128)
    each = one_by_one(scene.images, scene.cameras, STORE.stages("edge"))
    once = predict(scene.images, scene.cameras, NEAR, FAR, STORE.network("edge"))
    for found, want in zip(each.layers, once.layers, strict=True):
        assert np.median(np.linalg.norm(found.means - want.means, axis=-1)) < 0.01 * NEAR
        for name in ("scales", "opacities", "sh"):
            values, expected = getattr(found, name), getattr(want, name)
            assert np.mean(np.abs(values - expected)) < 0.02 * np.abs(expected).max(), name


def test_a_file_of_ones_own_has_no_stages_even_if_it_is_a_copy_of_a_network_that_has() -> None:
    assert STORE.has_stages("edge") and not STORE.has_stages("sweep")
    assert not STORE.has_stages(str(models_dir() / "edge.onnx"))


def test_a_stage_is_given_what_its_contract_says() -> None:
    for name, kind in STAGES.items():
        contract = CONTRACTS[f"stage_{name}"]
        assert set(kind.inputs) == set(contract.inputs) and set(contract.outputs) <= set(kind.outputs)
