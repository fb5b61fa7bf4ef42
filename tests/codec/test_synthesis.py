"""Views synthesised whole and in halves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tinysplat_runtime as ts
from tests.scenes import make_smooth_gaussians
from tinysplat_runtime.codec.synthesis import LayerSynthesis, coded_channels
from tinysplat_runtime.container.body import Container
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.graphs.inference import GraphStore

STORE = GraphStore(threads=1)
VIEWS, HEIGHT, WIDTH = 2, 280, 256  # more pixels than are made at a time


@pytest.fixture(scope="module")
def container() -> Container:
    return read_container(ts.Runtime(threads=1).compress(make_smooth_gaussians(VIEWS, HEIGHT, WIDTH, 2)))


def synthesise(container: Container, *, halves: bool) -> Gaussians:
    """Gaussians of made-up codes of the container's layer."""
    layer = container.body.layers[0]
    rng = np.random.default_rng(0)
    result = LayerSynthesis(layer, container.origin, STORE)
    for view in range(VIEWS):
        planes = [rng.integers(0, 4096, (len(c) + 1, HEIGHT, WIDTH)).astype(np.uint16) for c in coded_channels(layer)]
        for codes in planes:
            codes[-1] = 1
        geometry, colors = planes
        if halves:
            result.run(view, colors=colors)
            result.run(view, geometry)
        else:
            result.run(view, geometry, colors)
    return result.gaussians()


def with_principal_row(container: Container, row: float) -> Container:
    """The same file seen by cameras of another principal point."""
    layer = container.body.layers[0]
    cameras = []
    for camera in layer.cameras:
        K = camera.K.copy()
        K[1, 2] = row
        cameras.append(replace(camera, K=K))
    body = replace(container.body, layers=(replace(layer, cameras=tuple(cameras)),))
    return replace(container, body=body)


def test_views_made_at_once_and_in_halves_have_the_same_bits(container: Container) -> None:
    for row in (HEIGHT / 2, 1 / 3):
        scene = with_principal_row(container, row)
        whole, halves = synthesise(scene, halves=False), synthesise(scene, halves=True)
        assert whole.count == VIEWS * HEIGHT * WIDTH
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(halves, name), getattr(whole, name), err_msg=name)


def test_coded_channels_are_each_there_once_in_the_files_order(container: Container) -> None:
    layer = container.body.layers[0]
    geometry, colors = coded_channels(layer)
    assert sorted(geometry + colors) == [i for i, channel in enumerate(layer.channels) if channel.streams]
    assert all(layer.channels[i].name.startswith("color") for i in colors)
    assert geometry == sorted(geometry) and colors == sorted(colors)
