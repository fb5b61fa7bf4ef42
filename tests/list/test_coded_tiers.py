"""Mode list in tiers: what a prefix shows, what the whole file comes to, and who refuses it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import list_in_tiers, make_list

import tinysplat_runtime as ts
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians

COUNT = 800
GROWTHS = 0.3, 0.1


def cloud() -> Gaussians:
    return make_list(COUNT, 1, np.random.default_rng(1))


@pytest.fixture(scope="module")
def data() -> bytes:
    return list_in_tiers(cloud(), -12.0, GROWTHS)


def ends_of(data: bytes) -> list[int]:
    return [entry["bytes"] for entry in ts.inspect(data)["prefixes"]]


def first(gaussians: Gaussians, count: int) -> Gaussians:
    return replace(gaussians, **{name: getattr(gaussians, name)[:count] for name in FIELDS})


def is_alike(a: Gaussians, b: Gaussians, names: tuple[str, ...]) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in names)


def test_every_gaussian_comes_back_in_its_tier(data: bytes) -> None:
    gaussians, decoded = cloud(), ts.decompress(data)
    distances = np.linalg.norm(decoded.means[:, None] - gaussians.means[None], axis=-1)
    nearest = distances.argmin(axis=1)
    assert sorted(nearest.tolist()) == list(range(COUNT))
    ranks = np.argsort(np.argsort(-gaussians.opacities, kind="stable"))[nearest]
    assert [ranks[:80].max(), ranks[80:240].max(), ranks[240:].min()] == [79, 239, 240]
    for name, bound in (("opacities", 0.05), ("sh", 0.4)):
        assert np.abs(getattr(decoded, name) - getattr(gaussians, name)[nearest]).max() < bound
    scales = decoded.scales, gaussians.scales[nearest]
    sizes = [np.log(np.sort(each, axis=1)[:, 1:]) for each in scales]
    assert np.abs(sizes[0] - sizes[1]).max() < 0.3


def test_info_tells_of_tiers_and_where_each_shows(data: bytes) -> None:
    described = ts.inspect(data)
    assert described["tiers"] == [80, 160, 560] and described["gaussians"] == COUNT
    passes = [(entry["layer"], entry["adds"][0], entry["adds"][-1]) for entry in described["prefixes"]]
    last = f"color{described['k'] - 1}"
    first_of = [(0, "opacity0", "scale2"), (0, "color0", last), (0, "rotation0", "rotation2")]
    others = [(tier, *names) for tier in (1, 2) for names in (("opacity0", last), ("rotation0", "rotation2"))]
    assert passes == first_of + others and ends_of(data)[-1] == len(data)
    assert sum(described["bytes_by_class"].values()) + described["metadata_bytes"] == len(data)


@pytest.mark.parametrize(
    ("number", "count", "growth", "spheres"),
    [
        (0, 80, GROWTHS[0], True),
        (1, 80, GROWTHS[0], True),
        (2, 80, GROWTHS[0], False),
        (3, 240, GROWTHS[1], True),
        (4, 240, GROWTHS[1], False),
        (5, 800, 0.0, True),
        (6, 800, 0.0, False),
    ],
)
def test_a_prefix_shows_the_tiers_before_it_in_a_size_to_match(
    data: bytes, number: int, count: int, growth: float, spheres: bool
) -> None:
    whole, found = first(ts.decompress(data), count), ts.decompress(data, max_bytes=ends_of(data)[number])
    assert is_alike(found, whole, ("means", "opacities"))
    last = [0, 0, 0, 80, 80, 240, 240][number]
    logs: list[NDArray] = [np.log(g.scales.astype(np.float64)) for g in (found, whole)]
    np.testing.assert_allclose(logs[0][:last], logs[1][:last] + growth, atol=1e-5)
    wanted = np.repeat(logs[1].mean(axis=1, keepdims=True), 3, axis=1) if spheres else logs[1]
    np.testing.assert_allclose(logs[0][last:], wanted[last:] + growth, atol=1e-5)
    assert is_alike(found, whole, ("quats",)) != spheres
    assert is_alike(found, whole, ("sh",)) == (number > 0)


def test_until_a_tier_has_its_colours_the_ones_before_it_are_shown(data: bytes) -> None:
    ends = ends_of(data)
    assert [ts.decompress(data, max_bytes=end - 1).count for end in ends[3:]] == [80, 240, 240, 800]
    with pytest.raises(FormatError):
        ts.decompress(data, max_bytes=len(data) - sum(s for s in ts.inspect(data)["bytes_by_class"].values()))


def test_a_damaged_picture_leaves_out_its_tier_and_those_behind_it(data: bytes) -> None:
    damaged = bytearray(data)
    damaged[ends_of(data)[3] - 5] ^= 1
    lost: list[str] = []
    decoded = ts.Runtime(threads=1).decompress(bytes(damaged), lost=lost)
    assert decoded.count == 80 and len(lost) == 1 and lost[0].startswith("tier 1 color")
    damaged = bytearray(data)
    damaged[-5] ^= 1
    assert ts.Runtime(threads=1).decompress(bytes(damaged), lost=lost).count == 800
