"""What layers say of themselves in `info`: their maps, and what was left out of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tinysplat_runtime.container.layers import LayerHeader
from tinysplat_runtime.container.records import ChannelRecord, StreamRef
from tinysplat_runtime.gaussian.planes import PlaneClass
from tinysplat_runtime.scene.cameras import Camera

CAMERA = Camera([[9, 0, 2], [0, 9, 1], [0, 0, 1]], np.eye(4), 4, 3)
PICTURE = (StreamRef(0, 5, 0), StreamRef(5, 7, 0))


def layer(degree: int, source: int, k: int | None) -> LayerHeader:
    d = 3 * (degree + 1) ** 2
    return LayerHeader(
        cameras=(CAMERA, CAMERA), depth_limits=(1.5, 7.0), degree=degree, source_degree=source, energy_lost=0.25,
        condition=3.0, parameter_set=0, basis=None if k is None else np.zeros((d, k), np.float16),
        channels=(ChannelRecord(PlaneClass.DEPTH, 0, 3, 0.1, 0.2, PICTURE),
                  ChannelRecord(PlaneClass.SCALE, 1, 3, 0, 0.5)),
    )  # fmt: skip


def test_some_views_of_a_layer_are_what_they_were_in_the_whole() -> None:
    quats = np.arange(8, dtype=np.float32).reshape(2, 4)
    one = replace(layer(1, 1, 2), reference_quats=quats).select([1])
    assert one.cameras == (CAMERA,) and one.gaussians == 12
    np.testing.assert_array_equal(one.reference_quats, quats[1:])
    assert [channel.streams for channel in one.channels] == [(PICTURE[1],), ()]
    assert layer(1, 1, 2).select([1, 0]).channels[0].streams == PICTURE[::-1]
