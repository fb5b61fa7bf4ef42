"""Rounding at the ends of what is accepted stays within a few roundings times how much a result moves with its inputs,
as docs/NUMERICS.md states; and numbers there are coded, or refused by name.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from reference.transforms import pixel_centres, project_view, unproject_view
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.codec.analysis import project_layer
from tinysplat_runtime.codec.basis import (
    mean_magnitude_weighting,
    reduce_basis,
    second_moment_weighting,
    view_directions,
    weighted_spectrum,
)
from tinysplat_runtime.codec.encoder import map_channel
from tinysplat_runtime.codec.job import EncodeStats
from tinysplat_runtime.codec.quantise import OUTLIER_SHARE
from tinysplat_runtime.errors import NumericError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.planes import MAX_CODE, Channel, PlaneClass
from tinysplat_runtime.gaussian.quaternions import matrices_to_quats, normalize_quats, quats_to_matrices
from tinysplat_runtime.gaussian.sh import sh_basis
from tinysplat_runtime.graphs.inference import GraphStore, as_input
from tinysplat_runtime.scene.cameras import Camera

STORE = GraphStore(threads=1)
EPS32, EPS64 = 2.0**-24, 2.0**-53
ROUNDINGS = 8
"""On the way to a channel: three differences, a dot product of three, a division and a product."""

SIDE = 8
AXIS = np.array([0.3, 1.0, -0.2]) / np.linalg.norm([0.3, 1.0, -0.2])


def turn_of(angle: float) -> NDArray:
    return np.append(np.cos(angle / 2), np.sin(angle / 2) * AXIS)


def lens(focal: float, skew: float = 0.0, centre: tuple[float, float] = (4.1, 3.9)) -> NDArray:
    return np.array([[focal, skew, centre[0]], [0, 1.05 * focal, centre[1]], [0, 0, 1]])


def seen(distance=0.0, depths=(2.0, 4.0), K=None, angle=0.3, scale=1.0, quat_length=1.0) -> Gaussians:
    """Gaussians about the pixels of a camera `distance` from the world's origin; scales in footprints of a pixel."""
    rng = np.random.default_rng(7)
    c2w = np.eye(4)
    c2w[:3, :3] = quats_to_matrices(turn_of(angle)).T
    c2w[:3, 3] = distance * np.array([1.0, -0.7, 0.4]) + (0.3, 0.2, -0.1)
    camera = Camera(lens(9.0) if K is None else K, c2w, SIDE, SIDE)
    z = np.geomspace(*depths, SIDE * SIDE)[rng.permutation(SIDE * SIDE)].reshape(1, SIDE, SIDE, 1)
    uv = pixel_centres(SIDE, SIDE)[None] + rng.uniform(-0.4, 0.4, (1, SIDE, SIDE, 2))
    rays = np.concatenate([uv, np.ones_like(z)], axis=-1) @ np.linalg.inv(camera.K).T
    origin = camera.centre if distance else np.zeros(3)
    scales = scale * z / camera.focal * rng.uniform(0.3, 1.5, (1, SIDE, SIDE, 3))
    quats = normalize_quats(rng.normal(size=(1, SIDE, SIDE, 4))) * quat_length
    means = rays * z @ camera.rotation + (camera.centre - origin)
    sh, opacities = np.zeros((1, SIDE, SIDE, 1, 3)), np.full((1, SIDE, SIDE), 0.5)
    return Gaussians(means, quats, scales, opacities, sh, (camera,), origin)


ENDS_OF_PROJECTION = {
    "ordinary": {},
    "centred at 1e3": {"distance": 1e3},
    "centred at 1e7": {"distance": 1e7},
    "z of 1e-4": {"depths": (1e-4, 2e-4)},
    "z of 1e6": {"depths": (1e6, 2e6)},
    "far/near of 1e8": {"depths": (1e-2, 1e6)},
    "focal length 1e-2 px": {"K": lens(1e-2)},
    "focal length 1e6 px": {"K": lens(1e6)},
    "skew as large as the focal length": {"K": lens(9.0, 9.0)},
    "principal point 1e4 px outside": {"K": lens(9.0, 0.0, (-1e4, 1e4))},
    "rotation 0": {"angle": 0},
    "rotation 1e-9": {"angle": 1e-9},
    "rotation π − 1e-9": {"angle": np.pi - 1e-9},
    "rotation π": {"angle": np.pi},
    "scales of 1e-12 footprints": {"scale": 1e-12},
    "scales of 1e6 footprints": {"scale": 1e6},
    "quaternions of length 1e-37": {"quat_length": 1e-37},
    "quaternions of length 1e37": {"quat_length": 1e37},
    "denormal quaternions": {"quat_length": 1e-42},
}


@pytest.mark.parametrize("case", ENDS_OF_PROJECTION)
def test_projection_keeps_its_bounds(case: str) -> None:
    g = seen(**ENDS_OF_PROJECTION[case])
    camera = g.cameras[0]
    wanted = project_view(g, 0).reshape(11, -1)
    found = project_layer(STORE, g, drop_invalid=False, where="").geometry[0].reshape(11, -1)
    wanted[6:10] *= np.sign((wanted[6:10] * found[6:10]).sum(axis=0))  # q and −q are one rotation
    error = np.abs(found - wanted)
    rays = g.means.reshape(-1, 3).astype(np.float64) + (g.origin - camera.centre)
    reach = np.abs(rays) @ np.abs(camera.rotation.T)  # what the dot products sum up
    kappa = max((reach[:, 2] / wanted[0]).max(), 1.0)
    K = np.abs(camera.K)
    pixels = kappa * max(
        ((reach @ K[0]) / wanted[0]).max() + K[0, 2] + SIDE, ((reach @ K[1]) / wanted[0]).max() + K[1, 2] + SIDE
    )
    assert (error[0] <= ROUNDINGS * EPS32 * kappa * wanted[0]).all()
    assert (error[1:3] <= ROUNDINGS * EPS32 * pixels).all()
    assert (error[3:6] <= ROUNDINGS * EPS32 * (1 + kappa) * wanted[3:6] + np.finfo(np.float32).tiny).all()
    assert (error[6:10] <= ROUNDINGS * EPS32).all()


@pytest.mark.parametrize("case", [name for name in ENDS_OF_PROJECTION if "quat" not in name])
def test_inverse_projection_keeps_its_bounds(case: str) -> None:
    """Every pixel as a view of one pixel, whose plane of ones then carries any value."""
    g = seen(**ENDS_OF_PROJECTION[case])
    camera, count = g.cameras[0], SIDE * SIDE
    geometry = project_view(g, 0).astype(np.float32)
    K = np.repeat(camera.K[None], count, axis=0)
    K[:, :2, 2] -= (pixel_centres(SIDE, SIDE) - 0.5).reshape(-1, 2)
    rotation, centre = camera.rotation.T, camera.centre - g.origin
    inputs = {
        "geometry_codes": np.ones((count, 1, 1, 1), np.uint16),
        "geometry_mix": geometry.reshape(11, -1).T[..., None],
        "color_codes": np.ones((count, 1, 1, 1), np.uint16),
        "color_mix": np.zeros((1, 3), np.float32),
        "K": as_input(K),
        "rotation": as_input(np.repeat(rotation[None], count, axis=0)),
        "rotation_quat": as_input(np.repeat(matrices_to_quats(rotation)[None], count, axis=0)),
        "centre": as_input(np.repeat(centre[None], count, axis=0)),
        "inverse_depth": np.array(0, np.float32),
        "relative_rotation": np.array(0, np.float32),
        "depth_limits": as_input([1e-30, 1e30]),
    }
    back = STORE.transform("synthesis").run(inputs)
    wanted = unproject_view(geometry.astype(np.float64), camera, g.origin)
    slope = (SIDE + abs(camera.K[1, 2])) / camera.K[1, 1]
    slope += (SIDE + abs(camera.K[0, 2]) + camera.K[0, 1] * slope) / camera.K[0, 0]
    condition = 1 + slope + np.abs(centre).sum() / geometry[0].min()
    error = np.abs(back["means"].reshape(-1, 3) - wanted["means"].reshape(-1, 3)) / geometry[0].reshape(-1, 1)
    assert error.max() <= ROUNDINGS * EPS32 * condition
    np.testing.assert_allclose(back["scales"].reshape(-1, 3), wanted["scales"].reshape(-1, 3), rtol=ROUNDINGS * EPS32)


@pytest.mark.parametrize("stretch", [(1, 1, 1), (1e-5, 1e-5, 1), (1, 1, 1e7)])
def test_harmonics_keep_their_bound(stretch: tuple[float, ...]) -> None:
    rng = np.random.default_rng(1)
    rays = rng.normal(size=(60, 3)) * stretch
    basis = sh_basis(rays / np.linalg.norm(rays, axis=-1, keepdims=True), 4)
    narrow = sh_basis((rays / np.linalg.norm(rays, axis=-1, keepdims=True)).astype(np.float32), 4)
    coefficients = rng.normal(size=basis.shape).astype(np.float32)
    error = np.abs((narrow * coefficients).sum(-1) - (basis * coefficients).sum(-1))
    assert (error <= 40 * EPS32 * np.abs(basis * coefficients).sum(-1)).all()


# ---- basis reduction ------------------------------------------------------------------------------------------------

DEGREE, FUNCTIONS, D = 4, 25, 75


def camera_of(field_of_view: float, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Camera:
    focal, c2w = 32 / np.tan(np.radians(field_of_view) / 2), np.eye(4)
    c2w[:3, :3] = quats_to_matrices(normalize_quats(np.array([1.0, *turn])))
    return Camera(np.array([[focal, 0, 32], [0, focal, 32], [0, 0, 1]]), c2w, 64, 64)


_RNG = np.random.default_rng(3)
_FULL = _RNG.normal(size=(400, D)) * np.repeat(1 / (1 + np.arange(FUNCTIONS)), 3)
SPECTRA = {
    "full rank": _FULL,
    "rank 2": _RNG.normal(size=(400, 2)) @ _RNG.normal(size=(2, D)),
    "all coefficients equal": np.full((400, D), 0.37),
    "one Gaussian": _FULL[:1],
    "12 Gaussians": _FULL[:12],
    "repeated eigenvalues": np.concatenate([np.eye(D), -np.eye(D)]),
    "all zero": np.zeros((400, D)),
    "coefficients of 1e4": _FULL * 1e4,
    "coefficients of 1e-15": _FULL * 1e-15,
}


@pytest.mark.parametrize("k", [1, 6, D])
@pytest.mark.parametrize("case", SPECTRA)
def test_reduction_of_degenerate_spectra_loses_no_more_than_its_bound(case: str, k: int) -> None:
    """Beyond the best rank-k approximation, in the weighted norm. Float32 moments see directions down to a root of its
    roundoff, and W is rounded to float16.
    """
    delta = second_moment_weighting(view_directions([camera_of(60, (0.21, -0.13, 0.08))]), DEGREE)
    weights, x = np.kron(delta, np.eye(3)), SPECTRA[case].astype(np.float32)
    singular = np.linalg.svd(x.astype(np.float64) @ weights.T, compute_uv=False)
    total = float(np.linalg.norm(singular)) or 1.0
    moment = (x.T @ x / np.float32(len(x))).astype(np.float64)
    reduced = reduce_basis(weighted_spectrum(moment, delta), delta, k)
    planes = x @ reduced.projection.astype(np.float32)
    rest = np.linalg.norm((x - planes.astype(np.float64) @ reduced.inverse.astype(np.float64).T) @ weights.T) / total
    excess = max(rest**2 - np.square(singular[k:]).sum() / total**2, 0.0) ** 0.5
    assert excess <= (2.0**-9 + EPS32**0.5 if k < D else 40 * EPS32 * np.linalg.cond(delta))


@pytest.mark.parametrize("case", SPECTRA)
def test_the_basis_of_a_degenerate_spectrum_is_orthonormal_and_repeatable(case: str) -> None:
    delta = second_moment_weighting(view_directions([camera_of(60, (0.2, 0.1, 0.0))]), DEGREE)
    x = SPECTRA[case].astype(np.float32).astype(np.float64)
    moment = x.T @ x / len(x)
    values, vectors = weighted_spectrum(moment, delta)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(len(vectors)), atol=1e-12)
    assert (np.diff(values) <= 0).all() and values[-1] >= 0
    again = weighted_spectrum(moment.copy(), delta.copy())
    assert (again[0] == values).all() and (again[1] == vectors).all()


@pytest.mark.parametrize("field_of_view", [170.0, 1.0, 1e-3, 1e-5])
@pytest.mark.parametrize("weighting", [mean_magnitude_weighting, second_moment_weighting])
def test_weightings_are_finite_and_bounded_for_any_field_of_view(field_of_view: float, weighting) -> None:
    delta = weighting(view_directions([camera_of(field_of_view)]), 4)
    assert np.isfinite(delta).all() and np.linalg.cond(delta) < 1e4


# ---- quantiser ------------------------------------------------------------------------------------------------------


_SMOOTH = np.random.default_rng(2).normal(size=(1, 64, 64))
_OUTLIER = np.where(np.arange(4096).reshape(1, 64, 64) == 325, 1e9, _SMOOTH)
STRAINED = {
    "ordinary": (_SMOOTH, 1 / 8, 0),
    "one outlier of 1e9 σ": (_OUTLIER, 1 / 8, 1),
    "two values 1 apart": (np.where(_SMOOTH > 0, 1.0, 0.0), 0.5, 0),
    "two values 1e6 apart": (np.where(_SMOOTH > 0, 1e6, 0.0), 1.0, 0),  # half the plane is no outlier
    "values at 1e9 ± 200": (1e9 + 64 * np.round(_SMOOTH), 8.0, 0),
    "range of 2¹⁶ steps": (_SMOOTH * 2.0**13, 1.0, None),
    "range of 1e-30": (_SMOOTH * 1e-30, 1e-31, None),
    "range of 1e14": (_SMOOTH * 1e14, 1e13, None),
}


@pytest.mark.parametrize("case", STRAINED)
def test_planes_that_strain_12_bits_are_within_a_step_or_clipped_and_counted(case: str) -> None:
    values, step, wanted = STRAINED[case]
    values = values.astype(np.float32)
    mapped = map_channel(Channel(PlaneClass.COLOR, 0, values, step, (float(values.min()), float(values.max()))))
    codes = mapped.code_map
    if codes.scale == 0:  # one number for all
        assert np.abs(values - codes.offset).max() <= 1e-7
        return
    coded, clipped = mapped.codes(0)
    assert clipped <= OUTLIER_SHARE * values.size and wanted in (None, clipped)
    assert case != "one outlier of 1e9 σ" or codes.step == pytest.approx(step)
    inside = (values >= codes.offset - codes.scale) & (values <= codes.offset + (MAX_CODE + 1) * codes.scale)
    assert np.abs(codes.dequantise(coded[None]).astype(np.float64) - values)[inside].max() <= codes.step


@pytest.mark.parametrize("profile", ["paper", "balanced"])
def test_one_wild_gaussian_costs_the_others_nothing_and_is_counted(profile: str) -> None:
    g = make_smooth_gaussians(2, 32, 40, 1)
    scales = g.scales.copy()
    scales[0, 3, 4] = 1e6
    stats = EncodeStats()
    runtime = ts.Runtime(threads=1)
    found = runtime.decompress(runtime.compress(replace(g, scales=scales), profile, stats=stats))
    usual = runtime.decompress(runtime.compress(g, "balanced"))
    rest = np.ones(g.opacities.shape, bool)
    rest[0, 3, 4] = False
    errors = [np.abs(s.scales - g.scales)[rest].mean() for s in (found, usual)]
    if profile == "balanced":
        assert stats.clipped["scale"] >= 1
        assert errors[0] <= 2 * errors[1]
    else:  # steps of the paper are shares of σ, which the one Gaussian makes: what it asks for, with nothing unsaid
        assert np.isfinite(found.scales).all()


# ---- the whole chain at the ends of float32 -------------------------------------------------------------------------

ENDS = [1e-45, 1e-38, 1e-20, 1e10, 1e19, 1e30, 3e38]


@pytest.mark.parametrize("profile", ["paper", "balanced"])
@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("share", ["one", "all"])
def test_numbers_at_the_ends_are_coded_or_refused_by_name(profile: str, name: str, share: str) -> None:
    g = make_smooth_gaussians(2, 8, 8, 1)
    runtime = ts.Runtime(threads=1)
    for value in ENDS:
        array = getattr(g, name).astype(np.float64)
        limit = min(value, 1.0) if name == "opacities" else value
        if share == "one":
            array[0, 2, 3] = limit
        else:
            array *= limit / np.abs(array).max()
            if name == "quats":
                array[..., 0] = np.where(np.abs(array).max(axis=-1) < 1e-44, limit, array[..., 0])
        changed = replace(g, **{name: array.astype(np.float32)})
        try:
            decoded = runtime.decompress(runtime.compress(changed, profile, drop_invalid=True))
        except NumericError as error:
            assert value > 1e15, error
            continue
        assert all(np.isfinite(getattr(decoded, field)).all() for field in FIELDS)


def test_focal_lengths_from_a_hundredth_to_a_million_pixels_survive_coding() -> None:
    for focal in (1e-2, 1e6):
        g = make_smooth_gaussians(1, 8, 8, 0)
        camera = g.cameras[0]
        K = np.array([[focal, 0, 4], [0, focal, 4], [0, 0, 1]])
        z = np.linspace(2, 4, 64).reshape(1, 8, 8)
        v, u = np.mgrid[:8, :8] + 0.5
        rays = np.stack([(u - 4) / focal, (v - 4) / focal, np.ones_like(u)], axis=-1)
        means = (rays * z[..., None]) @ camera.rotation + camera.centre
        scene = ts.Gaussians(means, g.quats, g.scales, g.opacities, g.sh, (Camera(K, camera.c2w, 8, 8),))
        found = ts.decompress(ts.compress(scene, "paper", -12))
        depth = (found.means - camera.centre) @ camera.rotation[2]
        np.testing.assert_allclose(depth, z, rtol=5e-3)
