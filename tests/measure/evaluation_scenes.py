"""Scenes to evaluate, small enough for a test: photos of a textured plane, four cameras, an index of windows."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.scene.pictures import write_png

HEIGHT, WIDTH, FOCAL = 48, 64, 60.0
PLANE_Z, SPACING = 4.0, 0.2  # 3 pixels from view to view

NEAR_WINDOW: dict[str, Any] = {"kind": "near", "context": [0, 2], "target": [1]}
WIDE_WINDOW: dict[str, Any] = {"kind": "wide", "context": [0, 3], "target": [1, 2]}


def plane_photo(x: float) -> NDArray:
    """(48, 64, 3) uint8, the plane as a camera at (x, 0, 0) sees it."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    u = u + x * FOCAL / PLANE_Z
    texture = np.stack([np.sin(u / 3) * np.cos(v / 4), np.sin(u / 5 + 1), np.cos(v / 3 + u / 7)], axis=-1)
    return (127.5 + 120 * texture).astype(np.uint8)


def write_eval_scene(folder: Path, windows: Sequence[Any] = (NEAR_WINDOW,), frames: int = 4) -> Path:
    """Write photos, cameras and an index; returns the folder."""
    folder.mkdir(parents=True)
    entries = []
    for i in range(frames):
        write_png(folder / f"{i}.png", plane_photo(SPACING * i))
        c2w = np.eye(4)
        c2w[0, 3] = SPACING * i
        K = [[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]]
        entry = {"file": f"{i}.png", "width": WIDTH, "height": HEIGHT, "K": K, "c2w": c2w.tolist()}
        entries.append(entry)
    document = {"frames": entries, "near": 1.0, "far": 30.0}
    (folder / "cameras.json").write_text(json.dumps(document))
    write_index(folder, windows)
    return folder


def write_index(folder: Path, windows: Sequence[Any]) -> None:
    """Write `eval_index.json` with the plane's depth range."""
    (folder / "eval_index.json").write_text(json.dumps({"near": 2.0, "far": 8.0, "windows": list(windows)}))
