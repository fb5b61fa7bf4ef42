"""Sheets of two results side by side: which windows are paired, what stands above each picture, and the pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import make_cameras, make_smooth_gaussians

from tinysplat.measure.show.sheets import gaussian_sheet, read_results
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.render import Renderer


def test_gaussians_are_seen_from_their_views_and_midway_between_neighbours() -> None:
    pair = tuple(make_smooth_gaussians(3, 12, 16, seed=seed) for seed in (0, 1))
    cameras = make_cameras(3, 12, 16)
    sheet = gaussian_sheet(pair, ("one", "two"), cameras, (24, 32))
    assert (sheet.name, sheet.title) == ("comparison", "A: one   B: two")
    labels = ["view 0", "between 0 and 1", "view 1", "between 1 and 2", "view 2"]
    assert [row.label for row in sheet.rows] == labels
    for row, camera in ((sheet.rows[0], cameras[0]), (sheet.rows[4], cameras[2])):
        for picture, scene in ((row.a, pair[0]), (row.b, pair[1])):
            np.testing.assert_allclose(picture, Renderer(scene).render(camera, (24, 32)), atol=1e-6)


def record(**changes: Any) -> dict[str, Any]:
    return {
        "scene": "fox", "kind": "near", "context": [0, 4], "targets": [1], "height": 12, "width": 16, "model": "edge",
        "profile": "paper", "qp": 0.0, "bytes": 4321, "views": 2, "pictures": "p", **changes,
    }  # fmt: skip


def test_results_are_entries_with_bytes(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text(json.dumps({"scenes": [record(), record(bytes=None)]}))
    assert read_results(tmp_path) == [record()]
    for text in ("{}", "[]", "no", '{"scenes": [{"bytes": 1}]}', '{"scenes": 3}'):
        path.write_text(text)
        with pytest.raises(InputError, match=r"results\.json: not results of an evaluation \("):
            read_results(tmp_path)
