"""Mode list: a list comes back as it was, up to the steps it was coded with."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import list_in_tiers, make_cameras, make_list, make_smooth_gaussians, refusing

import tinysplat_runtime as ts
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError, InputError, InputWarning
from tinysplat_runtime.gaussian.curve import cells_of, morton_keys
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.quaternions import quats_to_matrices
from tinysplat_runtime.list.coding.attributes import Columns, expanded, from_columns, to_columns
from tinysplat_runtime.list.coding.octree import decode_points, encode_points
from tinysplat_runtime.render.paths import ring
from tinysplat_runtime.scene.viewpoints import Viewpoint


def cloud(count: int = 700, degree: int = 1, seed: int = 1) -> Gaussians:
    return make_list(count, degree, np.random.default_rng(seed))


def coded(gaussians: Gaussians, qp: float = 0.0, profile: str = "balanced", threads: int = 1) -> bytes:
    return ts.Runtime(threads=threads).compress(gaussians, profile, qp, keep_all=True)


def partners(gaussians: Gaussians, decoded: Gaussians) -> Gaussians:
    """The originals of decoded Gaussians, by the nearest position, each taken once."""
    distances = np.linalg.norm(decoded.means[:, None] - gaussians.means[None], axis=-1)
    nearest = distances.argmin(axis=1)
    assert len(set(nearest.tolist())) == decoded.count
    return gaussians.taken(nearest)


def covariances(gaussians: Gaussians) -> NDArray:
    quats = gaussians.quats.astype(np.float64)
    axes = quats_to_matrices(quats / np.linalg.norm(quats, axis=1, keepdims=True))
    return np.einsum("nij,nj,nkj->nik", axes, gaussians.scales.astype(np.float64) ** 2, axes)


def errors(gaussians: Gaussians, qp: float) -> dict[str, float]:
    """By which each attribute comes back changed, places in radii of the scene."""
    decoded = ts.decompress(coded(gaussians, qp))
    original = partners(gaussians, decoded)
    assert decoded.degree == gaussians.degree and decoded.count == gaussians.count
    radius = np.linalg.norm(np.diff(np.percentile(gaussians.means, (5, 95), axis=0), axis=0)) / 2
    sizes = [np.log(np.sort(g.scales, axis=1)[:, 1:].astype(np.float64)) for g in (decoded, original)]
    before, after = covariances(original), covariances(decoded)
    return {
        "means": np.abs(decoded.means - original.means).max() / radius,
        "opacities": np.std(np.sqrt(decoded.opacities) - np.sqrt(original.opacities)),
        "sizes": np.sqrt(np.square(sizes[0] - sizes[1]).mean()),
        "covariances": np.median(np.linalg.norm(after - before, axis=(1, 2)) / np.linalg.norm(before, axis=(1, 2))),
        "sh": np.sqrt(np.square(decoded.sh - original.sh).mean()),
    }


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4])
def test_every_attribute_comes_back_the_nearer_the_finer_its_steps(degree):
    gaussians = cloud(600, degree)
    fine, coarse = (errors(gaussians, qp) for qp in (-21, -9))
    most = {"means": 2e-3, "opacities": 4e-3, "sizes": 0.03, "covariances": 0.04, "sh": 0.02}
    for name, error in fine.items():
        assert error < most[name] and error < 0.4 * coarse[name], name  # whose steps are four times as large


FAR = np.append(np.ones(39), 1e6)[:, None]
EXTREMES: dict[str, Callable[[Gaussians], Gaussians]] = {
    "one": lambda g: g.taken([0]),
    "two": lambda g: g.taken([0, 1]),
    "all equal": lambda g: g.taken([0] * 40),
    "all equal and one far": lambda g: replace(g, means=FAR * g.means).taken([0] * 39 + [39]),
    "a stray at a million": lambda g: replace(g, means=FAR * g.means),
    "a bulk in next to nothing": lambda g: replace(g, means=np.where(FAR == 1, 1e-36 * g.means, 1e6)),
    "needles": lambda g: replace(g, scales=g.scales * np.array([1e5, 1, 1e-5])),
    "flat": lambda g: replace(g, scales=g.scales * np.array([1, 1, 0])),
    "points": lambda g: replace(g, scales=np.zeros_like(g.scales)),
    "huge": lambda g: replace(g, scales=g.scales * 1e20, means=g.means * 1e20),
    "tiny": lambda g: replace(g, scales=g.scales * 1e-20, means=g.means * 1e-20),
    "opaque": lambda g: replace(g, opacities=np.ones_like(g.opacities)),
    "bright": lambda g: replace(g, sh=g.sh * 1e6),
    "no colour": lambda g: replace(g, sh=np.zeros_like(g.sh)),
    "wide range of sizes": lambda g: replace(g, scales=g.scales * np.geomspace(1e-6, 1e6, 40)[:, None]),
    "long quaternions": lambda g: replace(g, quats=g.quats * 1e18),
}


@pytest.mark.parametrize("qp", [0.0, 60.0, -60.0])
@pytest.mark.parametrize("case", EXTREMES)
def test_extreme_gaussians_come_back_finite_and_near(case, qp):
    gaussians = EXTREMES[case](cloud(40))
    decoded = ts.decompress(coded(gaussians, qp))
    checked = Gaussians(**{name: getattr(decoded, name) for name in FIELDS})  # finite and in range
    assert checked.count == gaussians.count
    if qp > 0:
        return
    size = float(np.abs(gaussians.means).max())
    bulk = float(np.linalg.norm(np.ptp(np.percentile(gaussians.means, (5, 95), axis=0), axis=0))) / 2
    moved = np.sort(gaussians.means, axis=0) - np.sort(checked.means, axis=0)
    near = np.abs(np.sort(gaussians.means, axis=0)) <= max(bulk, 1e-6 * size)
    assert np.abs(moved[near]).max(initial=0) <= max(0.15 * bulk, 1e-6 * size) and np.abs(moved).max() <= 0.2 * size
    logs = [np.sort(np.log(np.maximum(g.scales.max(axis=1), 1e-25))) for g in (gaussians, checked)]
    assert np.median(np.abs(logs[0] - logs[1])) < 0.5


@pytest.mark.parametrize("far", [1e3, 1e8, 1e10, 1e20])
def test_a_stray_moves_nothing_else(far):
    """However far out it is: it keeps about its place, or is left out and said."""
    gaussians = cloud(300)
    means = gaussians.means.copy()
    means[7] = [far, -far, 0]
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found, alone = (ts.decompress(coded(one, 0)) for one in (replace(gaussians, means=means), gaussians))
    others = np.delete(gaussians.means, 7, axis=0)
    moved = [np.abs(others[:, None] - one.means[None]).max(axis=2).min(axis=1).max() for one in (found, alone)]
    assert moved[0] < 1.5 * moved[1] < 0.1
    is_kept = found.count == alone.count
    assert is_kept == (far <= 1e8) == (not any("left out" in str(one.message) for one in said))
    if is_kept:
        assert abs(np.abs(found.means).max() / far - 1) < 0.1


def _with(name: str, number: float, factor: float = 1.0) -> Gaussians:
    """A cloud whose sixth Gaussian has one number of this size, and all others that factor."""
    gaussians = cloud(300)
    array = getattr(gaussians, name) * np.float32(factor)
    array.reshape(300, -1)[5, 0] = number
    return replace(gaussians, **{name: array})


@pytest.mark.parametrize(
    ("name", "number", "factor"),
    [
        ("means", 1e29, 1e29),
        ("means", 2e30, 1),
        ("scales", 2e30, 1),
        ("scales", 1e30, 2e30),
        ("sh", 2e30, 1),
        ("sh", 1e30, 1e30),
        ("sh", -3e38, 1),
    ],
)
def test_what_no_reader_would_take_is_refused_by_its_name(name, number, factor):
    with pytest.raises(InputError) as caught:
        coded(_with(name, number, factor))
    assert caught.value.where == name


def test_so_many_equal_gaussians_that_no_byte_pays_for_them_are_refused():
    many = replace(cloud(2, 0).taken(np.zeros(200_000, int)), viewpoints=tuple(make_cameras(1)))
    with refusing(InputError, "200000 256"):
        coded(many)


def test_what_lies_too_far_out_is_left_out_of_its_tier_too():
    gaussians = cloud(60)
    means = np.where(np.arange(60)[:, None] == 5, np.float32(1e12), gaussians.means)
    with pytest.warns(InputWarning, match="1 Gaussians"):
        data = list_in_tiers(replace(gaussians, means=means))
    assert ts.decompress(data).count == 59


def test_targets_are_met():
    runtime, gaussians = ts.Runtime(threads=1), cloud(800, 1)
    data = runtime.compress(gaussians, target_size=9000, keep_all=True)
    assert 0.9 * 9000 <= len(data) <= 9000
    views = ring(gaussians, 4)
    better = runtime.decompress(runtime.compress(gaussians, target_psnr=42.0, keep_all=True))
    errors = [
        np.mean((ts.render(better, v, dilation="screen") - ts.render(gaussians, v, dilation="screen")) ** 2)
        for v in views
    ]
    assert np.mean([-10 * np.log10(e) for e in errors]) > 41.99


@pytest.mark.parametrize("options", [{"lossless": True}, {"like": b""}])
def test_what_needs_pixels_is_refused(options):
    if "like" in options:
        options = {"like": coded(cloud(20))}
    with pytest.raises(InputError):
        ts.compress(cloud(20), **options)


def test_a_prefix_shows_what_is_there_and_says_when_that_is_too_little():
    gaussians = cloud(3000, 1)
    data, runtime = coded(gaussians), ts.Runtime(threads=1)
    ends = [prefix["bytes"] for prefix in ts.inspect(data)["prefixes"]]
    assert len(ends) > 1 and ends[-1] == len(data)
    views = ring(gaussians, 2)
    raw = [ts.render(gaussians, view, (64, 64)) for view in views]
    errors = []
    for end in ends:
        decoded = runtime.decompress(data, max_bytes=end)
        assert decoded.count == 3000
        errors.append(sum(np.mean((ts.render(decoded, v, (64, 64)) - r) ** 2) for v, r in zip(views, raw, strict=True)))
    assert errors == sorted(errors, reverse=True) and errors[-1] < errors[0]
    with refusing(FormatError, "scale1"):
        runtime.decompress(data, max_bytes=_end_of(data, "scale1") - 1)
    with pytest.raises(FormatError):
        runtime.decompress(data, max_bytes=300)


def _end_of(data: bytes, name: str) -> int:
    return next(record.pictures[0].end for _, record in read_container(data).table.rows if record.name == name)


@pytest.mark.parametrize(("count", "side"), [(1, 1), (1, 0), (7, 1), (500, 4), (2000, 21), (9000, 3)])
def test_octrees_give_back_sorted_cells(count, side):
    cells = np.random.default_rng(count).integers(0, 1 << side, (count, 3)).astype(np.float64)
    keys = np.sort(morton_keys(cells))
    points = encode_points(keys, max(side, 1))
    found = decode_points(points.streams, points.levels, points.leaves, points.escapes, count)
    assert (found == keys).all()
    # independent of Morton codes: the same cells, as often
    assert sorted(map(tuple, cells_of(found).tolist())) == sorted(map(tuple, cells.tolist()))


def test_whatever_channels_decode_to_comes_to_valid_gaussians():
    rng = np.random.default_rng(0)
    wild = rng.choice([-1e20, -300.0, -1.0, 0.0, 0.5, 2.0, 300.0, 1e20], (400, 10))
    columns = Columns(*wild[:, :4].T, turns=wild[:, 4:7])
    with np.errstate(all="raise", under="ignore"):
        fields = from_columns(replace(columns, sizes=expanded(columns.sizes, 0.0)))
    made = Gaussians(means=np.zeros((400, 3)), sh=np.zeros((400, 1, 3)), **fields)
    assert (np.diff(made.scales, axis=1) <= 0).all()
    np.testing.assert_allclose(np.linalg.norm(made.quats, axis=1), 1, rtol=1e-6)


def test_turned_axes_show_the_same_gaussian_and_take_the_least_rotation():
    gaussians = cloud(400)
    columns = to_columns(gaussians, np.arange(gaussians.count))
    again = Gaussians(means=gaussians.means, sh=gaussians.sh, **from_columns(columns))
    np.testing.assert_allclose(
        covariances(again), covariances(gaussians), rtol=0, atol=1e-6 * covariances(gaussians).max()
    )
    assert (np.diff(again.scales, axis=1) <= 0).all()
    # half a turn about an axis changes nothing, so that a scalar part below 1/2 is never needed
    assert np.square(columns.turns).sum(axis=1).max() <= 0.75 + 1e-9


def test_what_a_file_costs_does_not_depend_on_how_far_cameras_were_off() -> None:
    flat = make_smooth_gaussians().flat()

    def stepped(turn: float) -> bytes:
        views = (Viewpoint.of(camera, turn=np.full(3, turn)) for camera in flat.viewpoints)
        return ts.Runtime(threads=1).compress(flat.changed(viewpoints=tuple(views)), keep_all=True)

    near, far = stepped(0.001), stepped(0.05)
    assert len(near) == len(far) and ts.Runtime(threads=1).decompress(far).viewpoints[0].turn[0] == np.float32(0.05)
