"""The optional section with cameras of the photos that a list of Gaussians was made from: docs/FORMAT.md, `SEEN`."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..gaussian.quaternions import matrices_to_quats, normalize_quats, quats_to_matrices
from ..scene.cameras import Camera
from .body import calibration, camera_in
from .layout import MAX_VIEWS
from .sections import Cursor, NewSection, Section, only

VIEWPOINTS = b"SEEN"
MINOR = 7
"""Minor version of a file with it, which readers that do not know it skip."""

CAMERA = struct.Struct("<3f4f4f2I")
"""Position relative to the origin (3), rotation to the world as wxyz (4), fx, fy, cx, cy, width, height."""

UNIT_TOLERANCE = 1e-3


def viewpoint_sections(cameras: Sequence[Camera], origin: NDArray) -> list[NewSection]:
    """The section, where there are cameras; `origin` is (3,) float64."""
    rows = []
    for camera in cameras[:MAX_VIEWS]:
        quat = matrices_to_quats(camera.rotation.T)
        lens = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
        numbers = np.array([*(camera.centre - origin), *quat, *lens], np.float32)
        rows.append(CAMERA.pack(*numbers.tolist(), camera.width, camera.height))
    return [NewSection(VIEWPOINTS, 0, b"".join(rows), MINOR, is_required=False)] if rows else []


def read_viewpoints(sections: Sequence[Section], origin: NDArray) -> tuple[Camera, ...]:
    """Parse and check the section, if it is there; FormatError where it is damaged. `origin` is (3,) float64."""
    if not any(section.kind == VIEWPOINTS for section in sections):
        return ()
    cursor = Cursor(only(sections, VIEWPOINTS))
    length = len(cursor.section.data)
    count, rest = divmod(length, CAMERA.size)
    cursor.require(
        not rest and 1 <= count <= MAX_VIEWS,
        f"{length} bytes, expected {CAMERA.size} for each of 1 to {MAX_VIEWS} cameras",
    )
    cameras = []
    for number in range(count):
        *numbers, width, height = cursor.unpack(CAMERA)
        values = np.array(numbers, np.float64)
        cursor.require(bool(np.isfinite(values).all()), f"camera {number}: not finite")
        quat, (fx, fy, cx, cy) = values[3:7], values[7:]
        is_unit = abs(float(np.linalg.norm(quat)) - 1) <= UNIT_TOLERANCE
        cursor.require(is_unit, f"camera {number}: a quaternion of another length than 1")
        c2w = np.eye(4)
        c2w[:3, :3], c2w[:3, 3] = quats_to_matrices(normalize_quats(quat)), values[:3] + origin
        cameras.append(camera_in(cursor.section, number, calibration(fx, fy, cx, cy, 0.0), c2w, width, height))
    return tuple(cameras)
