"""Every row of docs/NUMERICS.md keeps its bound, and numbers at the ends are coded, or refused by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from checks.conditioning import pictures, projection, reduction
from checks.conditioning.exact import holds
from tinysplat.measure.rows import Row
from tinysplat_runtime.codec.basis import (
    mean_magnitude_weighting,
    second_moment_weighting,
    view_directions,
    weighted_spectrum,
)
from tinysplat_runtime.codec.encoder import EncodeStats
from tinysplat_runtime.codec.quantise import OUTLIER_SHARE
from tinysplat_runtime.errors import NumericError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.graphs.inference import GraphStore
from tinysplat_runtime.render import render
from tinysplat_runtime.scene.cameras import Camera

STORE = GraphStore(threads=1)


def assert_bounds(rows: Sequence[Row]) -> None:
    broken = [(row.way, row.figures) for row in rows if not holds(row)]
    assert rows and broken == []


def test_projection_keeps_its_bounds_from_1e_4_to_1e7_units() -> None:
    rows = list(projection.projection_rows(STORE))
    assert_bounds(rows)
    far = next(row.figures for row in rows if row.way.startswith("centred at 1e7; depth"))
    assert far["ours"] <= 1e-6 < 1e-2 < far["float32"]


def test_inverse_projection_keeps_its_bounds() -> None:
    assert_bounds(list(projection.inverse_rows(STORE)))


def test_quaternions_of_rotations_are_exact_at_every_angle() -> None:
    assert_bounds(list(projection.rotation_rows()))


def test_harmonics_keep_their_bound() -> None:
    assert_bounds(list(pictures.sh_rows()))


def test_splats_keep_their_bound_where_an_inverted_covariance_is_not_even_finite() -> None:
    rows = {row.setting["case"]: row for row in pictures.splat_rows()}
    assert_bounds(list(rows.values()))
    assert rows["anisotropy 1e8, needles"].figures["float32"] > 0.1


# ---- basis reduction ------------------------------------------------------------------------------------------------


def test_reduction_of_degenerate_spectra_loses_no_more_than_its_bound() -> None:
    assert_bounds(list(reduction.spectrum_rows()))


@pytest.mark.parametrize("case", reduction.SPECTRUM_CASES)
def test_the_basis_of_a_degenerate_spectrum_is_orthonormal_signed_and_repeatable(case: str) -> None:
    delta = second_moment_weighting(view_directions([reduction.camera_of(60, (0.2, 0.1, 0.0))]), reduction.DEGREE)
    x = reduction.coefficients_of(case).astype(np.float64)
    moment = x.T @ x / len(x)
    values, vectors = weighted_spectrum(moment, delta)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(len(vectors)), atol=1e-12)
    assert (np.diff(values) <= 0).all() and values[-1] >= 0
    assert (vectors[np.abs(vectors).argmax(axis=0), range(len(vectors))] > 0).all()
    again = weighted_spectrum(moment.copy(), delta.copy())
    assert (again[0] == values).all() and (again[1] == vectors).all()


@pytest.mark.parametrize("field_of_view", [170.0, 1.0, 1e-3, 1e-5])
@pytest.mark.parametrize("weighting", [mean_magnitude_weighting, second_moment_weighting])
def test_weightings_are_finite_and_bounded_for_any_field_of_view(field_of_view: float, weighting) -> None:
    delta = weighting(view_directions([reduction.camera_of(field_of_view)]), 4)
    assert np.isfinite(delta).all() and np.linalg.cond(delta) < 1e4


# ---- quantiser ------------------------------------------------------------------------------------------------------


def test_planes_that_strain_12_bits_are_within_a_step_or_clipped_and_counted() -> None:
    found = list(pictures.quantiser_rows())
    rows = {row.way: row.figures for row in found}
    for row in rows.values():
        assert row["clipped"] <= OUTLIER_SHARE * 4096
        assert row["error"] <= (0.1 if row["reached"] else 1e-7), row
    assert rows["σ = 0"]["error"] == 0 and not rows["σ = 0"]["reached"]
    outlier = rows["one outlier of 1e9 σ"]
    assert outlier["reached"] == pytest.approx(outlier["wanted"]) and outlier["clipped"] == 1
    assert rows["two values 1e6 apart, step 1"]["clipped"] == 0  # half the plane is no outlier


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
        assert 1 <= stats.clipped["scale"] <= 3
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


@pytest.mark.parametrize("profile", ["paper", "balanced"])
def test_opacities_at_0_at_1_and_an_ulp_beside_come_back_in_range(profile: str) -> None:
    g = make_smooth_gaussians(1, 16, 16, 0)
    ends = np.float32([0, np.nextafter(np.float32(0), np.float32(1)), np.nextafter(np.float32(1), np.float32(0)), 1])
    opacities = np.resize(ends, g.opacities.shape)
    found = ts.decompress(ts.compress(replace(g, opacities=opacities), profile, -12)).opacities
    assert found.min() >= 0 and found.max() <= 1
    assert np.abs(found - opacities).max() < 0.05


def test_coefficients_ten_thousand_times_larger_come_back_ten_thousand_times_larger() -> None:
    g = make_smooth_gaussians(1, 24, 24, 4)
    large = replace(g, sh=g.sh * 2.0**13)
    found, usual = (ts.decompress(ts.compress(one, "paper")).sh for one in (large, g))
    np.testing.assert_allclose(found, usual * 2.0**13, rtol=1e-5, atol=0.01)
    picture = render(large, g.cameras[0])
    assert np.isfinite(picture).all() and picture.min() >= 0 and picture.max() <= 1


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
