"""How far attributes are from those of an original, on differences that are known."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_gaussians
from scipy.spatial.transform import Rotation

from tinysplat_runtime.gaussian.difference import attribute_errors


def test_errors_of_every_attribute_by_hand() -> None:
    """Two layers of 20 and 6 Gaussians, each changed in its own way."""
    whole = make_gaussians(1, 4, 5, degree=1, layers=2)
    first, second = whole.layers[0], whole.layers[1]
    n, m = first.opacities.size, second.opacities.size
    scales, opacities, sh = first.scales.copy(), first.opacities.copy(), first.sh.copy()
    scales[0, 1, 2, 0] += 0.5
    opacities[0, 3, 4] = 0.0
    sh[0, 2, 2, 3, 1] -= 2.0
    found = replace(
        first,
        means=first.means - np.float32([0, 3, 4]),
        scales=scales,
        opacities=opacities,
        sh=sh,
        extra_layers=(replace(second, means=second.means + np.float32([12, 0, 0])),),
    )
    errors = attribute_errors(whole, found)
    assert errors["means"]["rmse"] == pytest.approx(np.sqrt((25 * n + 144 * m) / (3 * (n + m))), rel=1e-5)
    assert errors["means"]["max"] == pytest.approx(12, rel=1e-5)
    assert errors["scales"]["max"] == pytest.approx(0.5, rel=1e-5)
    assert errors["scales"]["rmse"] == pytest.approx(0.5 / np.sqrt(3 * (n + m)), rel=1e-5)
    was = float(first.opacities[0, 3, 4])
    assert errors["opacities"]["max"] == pytest.approx(was, rel=1e-6)
    assert errors["opacities"]["rmse"] == pytest.approx(was / np.sqrt(n + m), rel=1e-6)
    assert errors["sh"]["max"] == pytest.approx(2, rel=1e-5)
    assert errors["sh"]["rmse"] == pytest.approx(2 / np.sqrt(12 * (n + m)), rel=1e-5)
    assert errors["quats"]["max"] == pytest.approx(0, abs=1e-5)


def test_places_are_compared_in_the_world() -> None:
    whole = make_gaussians(1, 3, 4).flat()
    moved = whole.changed(origin=np.array([1.0, -2, 0.5]))
    assert attribute_errors(whole, moved)["means"]["max"] == pytest.approx(2, rel=1e-6)
    assert attribute_errors(whole, moved)["means"]["rmse"] == pytest.approx(np.sqrt(5.25 / 3), rel=1e-6)
    same = replace(moved, means=whole.means - np.float32([1, -2, 0.5]))
    assert attribute_errors(whole, same)["means"]["max"] < 1e-5


@pytest.mark.parametrize("angle", [0.0, 1e-4, 0.5, 1.0, 3.0, np.pi])
def test_turns_are_told_in_degrees_whatever_length_and_sign_quaternions_have(angle: float) -> None:
    whole = make_gaussians(1, 3, 4).flat()
    turns = Rotation.from_quat(whole.quats.astype(float), scalar_first=True)
    axis = np.array([2.0, -1, 2]) / 3
    turned = (turns * Rotation.from_rotvec(angle * axis)).as_quat(scalar_first=True)
    signs = np.where(np.arange(12) % 2, -3.0, 0.5)[:, None]
    errors = attribute_errors(whole, replace(whole, quats=signs * turned))["quats"]
    assert errors["max"] == pytest.approx(np.degrees(angle), rel=1e-4, abs=2e-5)
    assert errors["rmse"] == pytest.approx(np.degrees(angle), rel=1e-4, abs=2e-5)
