"""What layers say of themselves in `info`: their maps, and what was left out of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tinysplat_runtime.container.layers import LayerHeader
from tinysplat_runtime.container.planes import _described, _left_out
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


@pytest.mark.parametrize(
    ("degree", "source", "k", "wanted"),
    [
        (1, 1, 12, []),
        (1, 1, 11, [{"layer": 2, "what": "color components", "kept": 11, "of": 12, "energy_lost": 0.25}]),
        (1, 3, 5, [
            {"layer": 2, "what": "sh degree", "kept": 1, "of": 3, "bytes_saved": 2 * 5 * (48 - 12)},
            {"layer": 2, "what": "color components", "kept": 5, "of": 12, "energy_lost": 0.25},
        ]),
        (0, 4, None, [
            {"layer": 2, "what": "sh degree", "kept": 0, "of": 4, "bytes_saved": 0},
            {"layer": 2, "what": "basis", "why": "SH degree 0 needs none"},
        ]),
        (0, 0, 1, [{"layer": 2, "what": "color components", "kept": 1, "of": 3, "energy_lost": 0.25}]),
    ],
)  # fmt: skip
def test_what_was_left_out_is_told_with_what_it_saves(degree: int, source: int, k: int | None, wanted: list) -> None:
    constant = {"layer": 2, "what": "plane scale1", "why": "constant", "value": 0.5}
    assert _left_out(2, layer(degree, source, k)) == [*wanted, constant]


def test_a_layer_is_described_by_its_numbers() -> None:
    made = layer(1, 2, 4)
    assert _described(made) == {
        "height": 3, "width": 4, "gaussians": 24, "sh_degree": 1, "k": 4, "depth_limits": [1.5, 7.0],
        "inverse_depth": True, "relative_rotation": False, "condition": 3.0, "energy_lost": 0.25,
    }  # fmt: skip
    turned = replace(made, reference_quats=np.zeros((2, 4), np.float32), inverse_depth=False, basis=None)
    assert (_described(turned)["relative_rotation"], _described(turned)["inverse_depth"]) == (True, False)
    assert turned.k == 0 and turned.height == 3 and turned.width == 4


def test_some_views_of_a_layer_are_what_they_were_in_the_whole() -> None:
    quats = np.arange(8, dtype=np.float32).reshape(2, 4)
    one = replace(layer(1, 1, 2), reference_quats=quats).select([1])
    assert one.cameras == (CAMERA,) and one.gaussians == 12
    np.testing.assert_array_equal(one.reference_quats, quats[1:])
    assert [channel.streams for channel in one.channels] == [(PICTURE[1],), ()]
    assert layer(1, 1, 2).select([1, 0]).channels[0].streams == PICTURE[::-1]
