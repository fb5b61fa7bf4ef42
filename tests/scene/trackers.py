"""Cameras as other tools' files have them, of photos 0000.png and so on: exports of Metashape, RealityScan, Bundler and
Meshroom. `terms` are of the tool's own lens, or take the place of what cameras say.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tinysplat_runtime.scene.cameras import Camera


def metashape(folder: Path, cameras: Sequence[Camera], kind: str = "frame", extra: str = "", **terms: Any) -> Path:
    """Camera to chunk with OpenCV axes, of which a component has the scale; the principal point from the middle."""
    K, width, height, scale = cameras[0].K, cameras[0].width, cameras[0].height, 2.5
    poses = [np.column_stack([c.c2w[:3, :3], c.centre / scale]) for c in cameras]
    placed = [
        f'<camera id="{i}" sensor_id="0" component_id="0" label="{i:04}">'
        f"<transform>{' '.join(map(repr, [*pose.ravel().tolist(), 0, 0, 0, 1]))}</transform></camera>"
        for i, pose in enumerate(poses)
    ]
    lens = {"f": K[1, 1], "b1": K[0, 0] - K[1, 1], "cx": K[0, 2] - width / 2, "cy": K[1, 2] - height / 2, **terms}
    (folder / "cameras.xml").write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0"><chunk label="Chunk 1" enabled="true">'
        f'<sensors next_id="1"><sensor id="0" label="X" type="{kind}"><resolution width="{width}" height="{height}"/>'
        f'<calibration class="adjusted">{"".join(f"<{name}>{value}</{name}>" for name, value in lens.items())}'
        '</calibration></sensor></sensors><components><component id="0"><transform>'
        f"<scale>{scale}</scale></transform></component></components><cameras>{''.join(placed)}"
        f'<camera id="9" sensor_id="0" label="lost"/>{extra}</cameras></chunk></document>'
    )
    return folder / "cameras.xml"


def realityscan(folder: Path, cameras: Sequence[Camera], **terms: Any) -> Path:
    """Angles about z, x and y of a camera that looks down; lengths of a picture 36 wide along its longer side."""
    K, width, height = cameras[0].K, cameras[0].width, cameras[0].height
    longer = max(width, height)
    lens = {"f": K[0, 0] * 36 / longer, "px": (K[0, 2] - width / 2) / longer, "py": (K[1, 2] - height / 2) / longer}
    lens |= dict.fromkeys(("k1", "k2", "k3", "k4", "t1", "t2"), 0)
    rows = []
    for i, c in enumerate(cameras):
        yaw, pitch, roll = Rotation.from_matrix(c.c2w[:3, :3] * [1, -1, -1]).as_euler("ZXY", degrees=True)
        place = dict(zip(("x", "y", "alt"), c.centre, strict=True)) | {"heading": -yaw, "pitch": pitch, "roll": roll}
        rows.append({"#name": f"{i:04}.png", **place, **lens, **terms})
    lines = [rows[0].keys(), *(row.values() for row in rows)]
    (folder / "cameras.csv").write_text("".join(",".join(map(str, line)) + "\n" for line in lines))
    return folder / "cameras.csv"


def bundler(folder: Path, cameras: Sequence[Camera], points: Any = (), k1: Any = 0.0, k2: Any = 0.0) -> Path:
    """Into a camera whose y points up and z backward; one that was not placed; points with a line of views."""
    blocks, flip = [], np.diag([1.0, -1, -1])
    for c in cameras:
        rows = np.vstack([flip @ c.w2c[:3, :3], flip @ c.w2c[:3, 3]])
        blocks += [f"{c.focal} {k1} {k2}", *(" ".join(map(repr, row)) for row in rows.tolist())]
    blocks += ["0 0 0"] * 5
    for point in points:
        blocks += [" ".join(map(str, point)), "9 9 9", "2 0 0 1.0 1.0 1 0 1.0 1.0"]
    counts = f"{len(cameras) + 1} {len(points)}"
    (folder / "bundle.out").write_text("\n".join(["# Bundle file v0.3", counts, *blocks]) + "\n")
    (folder / "list.txt").write_text("".join(f"./{i:04}.png 0 35.2\n" for i in range(len(cameras))) + "lost.png\n")
    return folder / "bundle.out"


def meshroom(
    folder: Path,
    cameras: Sequence[Camera],
    version: str = "1.2.8",
    view: dict[str, Any] | None = None,
    points: Any = (),
    **terms: Any,
) -> Path:
    """The rotation out of the camera row by row, words in place of numbers, millimetres of the sensor's width."""
    K, width, height = cameras[0].K, cameras[0].width, cameras[0].height
    lens = {"intrinsicId": "7", "width": str(width), "height": str(height), "type": "pinhole", "sensorWidth": "36"}
    lens |= {"focalLength": str(K[0, 0] * 36 / width), "pixelRatio": "1", "distortionType": "none"}
    lens |= {"principalPoint": [str(K[0, 2] - width / 2), str(K[1, 2] - height / 2)], **terms}
    views = [
        {"viewId": str(i), "poseId": str(i), "intrinsicId": "7", "path": f"C:\\shots\\{i:04}.png"}
        for i in range(len(cameras) + 1)
    ]
    views[0] |= view or {}
    turns = [{"rotation": c.c2w[:3, :3].ravel().astype(str).tolist()} for c in cameras]
    poses = [
        {"poseId": str(i), "pose": {"transform": {**turn, "center": c.centre.astype(str).tolist()}}}
        for i, (c, turn) in enumerate(zip(cameras, turns, strict=True))
    ]
    document = {"version": version.split("."), "views": views, "intrinsics": [lens], "poses": poses}
    landmarks = [{"X": [str(value) for value in point]} for point in points]
    (folder / "cameras.sfm").write_text(json.dumps({**document, "structure": landmarks}))
    return folder / "cameras.sfm"
