"""The made scene with which `doctor` tries providers, and what it says of a trial."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import make_smooth_gaussians

from tinysplat_runtime.cli import trial
from tinysplat_runtime.cli.trial import _photos, ran_by
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.graphs.providers import providers_of
from tinysplat_runtime.scene.cameras import Camera


def test_the_photos_show_a_plane_at_three_from_two_cameras() -> None:
    """What a camera sees at a pixel is the texture at the point of z = 3, whatever camera sees it."""
    images, cameras, near, far = _photos()
    assert images.shape == (2, 64, 64, 3) and images.dtype == np.float32 and (near, far) == (2, 6)
    assert 0.1 <= images.min() < 0.15 and 0.85 < images.max() <= 0.9
    for image, camera, x0 in zip(images, cameras, (-0.1, 0.1), strict=True):
        assert (camera.width, camera.height) == (64, 64)
        np.testing.assert_array_equal(camera.K, [[64, 0, 32], [0, 64, 32], [0, 0, 1]])
        np.testing.assert_array_equal(camera.c2w, [[1, 0, 0, x0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        for row, column in ((0, 0), (5, 40), (63, 17)):
            x, y = column / 64 * 3 + x0, row / 64 * 3
            expected = [0.5 + 0.4 * np.sin((20 + c) * x) * np.cos((15 + c) * y) for c in range(3)]
            np.testing.assert_allclose(image[row, column], expected, atol=1e-6)


@pytest.fixture(autouse=True)
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """A network takes seconds to load; its name stands for it."""
    monkeypatch.setattr(trial.GraphStore, "network", lambda store, name: name)


def test_every_graph_runs_and_says_on_what(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def predicted(images, cameras: tuple[Camera, ...], near: float, far: float, network):
        asked.append((images.shape, len(cameras), near, far, network))
        return make_smooth_gaussians(2, 16, 16, degree=0, layers=2)

    monkeypatch.setattr(trial, "predict", predicted)
    wrong: list[str] = []
    found = ran_by(providers_of("CPU"), wrong)
    assert asked == [((2, 64, 64, 3), 2, 2.0, 6.0, trial.DEFAULT_MODEL)] and wrong == []
    assert {"analysis_vpt", "analysis_moment", "analysis_project", "synthesis"} <= {*found}, found
    assert all(
        [*ran] == ["CPUExecutionProvider"] and ran["CPUExecutionProvider"] > 0 for name, ran in found.items() if ran
    )


def test_what_cannot_run_is_a_line_and_what_ran_before_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise InputError("does not run", where="sweep.onnx")

    monkeypatch.setattr(trial, "predict", fails)
    wrong: list[str] = []
    assert isinstance(ran_by(providers_of("CPU"), wrong), dict) and wrong == ["sweep.onnx: does not run"]
