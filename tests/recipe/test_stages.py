"""What files are held against for a wanted quality: which views, and how their pictures differ."""

from __future__ import annotations

import importlib
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import make_cameras, make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.recipe import stages
from tinysplat_runtime.recipe.encode import raw_bytes
from tinysplat_runtime.recipe.request import Coding
from tinysplat_runtime.recipe.words import Refinement

TOOLS: Any = SimpleNamespace(threads=3, store=None, limits=None)


class Flat:
    """A renderer whose pictures are of one level, by what it is given and by camera."""

    def __init__(self, given: Any, threads: int, compiled: bool) -> None:
        assert threads == 3 and not compiled
        self.level = given if isinstance(given, float) else 0.0

    def render(self, camera: Any) -> NDArray:
        number = camera if isinstance(camera, int) else 0
        return np.full((2, 3, 3), self.level * (1 + number) - 0.25 * (self.level == 0))


@pytest.mark.parametrize(
    ("count", "views"),
    [
        (1, [0]), (3, [0, 1, 2]), (16, list(range(16))), (17, [0, 1, 2, 3, 4, 5, 6, 7, 9, 10, 11, 12, 13, 14, 15, 16]),
        (31, list(range(0, 31, 2))), (301, list(range(0, 301, 20))),
    ],
)  # fmt: skip
def test_sixteen_views_at_most_spread_over_all_are_judged(monkeypatch, count: int, views: list[int]) -> None:
    drawn = []
    monkeypatch.setattr(stages, "Renderer", Flat)
    monkeypatch.setattr(Flat, "render", lambda self, camera: drawn.append(camera) or np.zeros((1, 1, 3)))
    stages._fidelity(SimpleNamespace(cameras=tuple(range(count))), TOOLS)
    assert drawn == views


def test_quality_is_the_mean_of_decibels_of_clipped_pictures(monkeypatch) -> None:
    monkeypatch.setattr(stages, "Renderer", Flat)
    monkeypatch.setattr(stages, "decode_gaussians", lambda data, store, threads, limits: float(data))
    measure = stages._fidelity(SimpleNamespace(cameras=(0, 1)), TOOLS)
    assert measure(b"0.25") == pytest.approx(np.mean([-20 * math.log10(0.25), -20 * math.log10(0.5)]))
    assert measure(b"5") == 0 and measure(b"0") == 150


def test_gaussians_of_no_pixels_are_judged_from_four_views_about_them(monkeypatch) -> None:
    asked = []
    monkeypatch.setattr(stages, "Renderer", Flat)
    monkeypatch.setattr(stages, "ring", lambda gaussians, count: asked.append(count) or [0] * count)
    stages._fidelity(SimpleNamespace(cameras=()), TOOLS)
    assert asked == [4]


@pytest.mark.parametrize(
    ("size", "whole", "networks", "found"),
    [
        ((480, 640), False, ("edge",), False), ((481, 640), False, ("edge",), True),
        ((481, 640), True, ("edge",), False),
        ((481, 640), False, ("sweep",), False), ((481, 640), False, None, False),
    ],
)  # fmt: skip
def test_large_photos_are_enlarged_from_small_ones_where_the_network_has_a_graph_for_it(
    monkeypatch, size, whole, networks, found
) -> None:
    graph = None if networks is None else SimpleNamespace(networks=networks)
    monkeypatch.setattr(stages.Enlarger, "of", classmethod(lambda cls, graph: graph))
    store = SimpleNamespace(enlarger=lambda: graph, shipped_network=lambda model: model)
    scene: Any = SimpleNamespace(cameras=make_cameras(2, *size))
    enlarger = stages.enlarger_of(scene, "edge", SimpleNamespace(store=store, threads=1, limits=None), whole=whole)
    assert (enlarger is graph is not None) is found and (enlarger is not None) is found


def test_refinement_is_given_its_steps_or_the_seconds_that_pixels_are_worth(monkeypatch) -> None:
    pytest.importorskip("numba")
    asked: list[dict[str, Any]] = []
    module = importlib.import_module("tinysplat_runtime.refine.refine")
    monkeypatch.setattr(module, "refine", lambda *given, **options: asked.append(options))
    scene: Any = SimpleNamespace(cameras=make_cameras(2, 500, 1000))
    for budget in (None, Refinement(), Refinement(steps=7), Refinement(seconds=3.0)):
        stages.refine(make_smooth_gaussians(), scene, budget, Coding(qp=4, profile="fast"), TOOLS)
    assert [(one["steps"], one["seconds"]) for one in asked] == [(None, None), (None, 30.0), (7, None), (None, 3.0)]
    assert {(one["qp"], one["profile"].name) for one in asked} == {(4.0, "fast")}


def test_raw_bytes_are_of_all_arrays_of_all_layers() -> None:
    one, two = (make_smooth_gaussians(2, 4, 6, 1, layers=layers) for layers in (1, 2))
    assert raw_bytes(one) == 4 * 48 * (3 + 4 + 3 + 1 + 12)
    layer = two.extra_layers[0]
    assert raw_bytes(two) == raw_bytes(one) + 4 * layer.count * (11 + layer.sh.shape[-2] * 3)


def test_a_report_says_what_was_measured() -> None:
    from tinysplat_runtime.codec.encoder import EncodeStats
    from tinysplat_runtime.recipe.encode import Encoded
    from tinysplat_runtime.recipe.report import encode_report

    runtime, gaussians, stats = ts.Runtime(threads=1), make_smooth_gaussians(2, 16, 24, 1), EncodeStats()
    data = runtime.compress(gaussians, stats=stats)
    coded = Encoded(data, gaussians, raw_bytes(gaussians), stats)
    report = encode_report(coded, runtime, model=None)
    assert report["bytes"] == len(data) and report["seconds"] == stats.watch.seconds
    assert set(report["error_by_attribute"]) == {"means", "quats", "scales", "opacities", "sh"}
    assert all(error["rmse"] > 0 for error in report["error_by_attribute"].values())
    assert (
        report["peak_rss_bytes"] > 10e6
        and "refine" not in report
        and coded.seconds == sum(stats.watch.seconds.values())
    )
