"""Photos are compared with their neighbours where there are many, and each with each where that leads nowhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from walls import write_photos_of_walls

from tinysplat.poses import placing


@pytest.fixture
def matched(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Ways of matching, in the order in which they are called."""
    called = []
    for name in ("match_sequential", "match_exhaustive"):
        original = getattr(pycolmap, name)

        def wrapped(*args: Any, name: str = name, original: Any = original, **options: Any) -> Any:
            called.append(name)
            return original(*args, **options)

        monkeypatch.setattr(pycolmap, name, wrapped)
    monkeypatch.setattr(placing, "ALL_PAIRS", 4)
    return called


def test_many_photos_are_matched_with_their_neighbours(tmp_path: Path, matched: list[str]) -> None:
    truth = np.stack([camera.centre for camera in write_photos_of_walls(tmp_path / "photos", 5)])
    (tmp_path / "work").mkdir()
    names = [f"{i}.png" for i in range(5)]
    model = placing.place(tmp_path / "photos", names, tmp_path / "work", -1, in_order=False, quiet=True)
    assert matched == ["match_sequential"] and model.num_reg_images() == 5
    images = {image.name: image for image in model.images.values()}
    found = np.stack([images[name].projection_center() for name in names])
    unit = np.linalg.norm(truth[4] - truth[0]) / np.linalg.norm(found[4] - found[0])
    np.testing.assert_allclose(unit * np.linalg.norm(np.diff(found, axis=0), axis=1), 0.35, rtol=0.05)
    points, colours, errors = placing.coloured_points(model)
    assert len(points) == len(colours) == len(errors) > 50 and errors.max() < 8
