"""Lenses told apart by fit: where one camera does not do for all photos, and nothing but their matches says so.

With a camera for every photo, focal lengths of one lens come out alike, and those of two lenses apart.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tinysplat_runtime.scene.lenses import load_pycolmap

if TYPE_CHECKING:
    from pycolmap import Reconstruction

GAP, SPREAD, LEAST = 0.1, 0.25, 3
"""Of a focal length, that two lenses differ by at least; of that gap, by which half of a lens's photos lie apart from
their median at most; and photos of each.
"""


def focal_lengths(model: Reconstruction) -> dict[str, float]:
    """Focal lengths of a model's photos by their names, pixels."""
    placed = (image for image in model.images.values() if image.has_pose)
    return {image.name: model.cameras[image.camera_id].mean_focal_length() for image in placed}


def lenses_of(focals: Mapping[str, float]) -> dict[str, int]:
    """Numbers of two lenses by photos, from their focal lengths; none where these do not tell two clearly."""
    names = sorted(focals, key=lambda name: focals[name])
    logs = np.log([focals[name] for name in names])
    gaps = np.diff(logs)[LEAST - 1 : len(logs) - LEAST]
    if not gaps.size or gaps.max() < GAP:
        return {}
    cut = LEAST + int(np.argmax(gaps))
    apart = [float(np.median(np.abs(part - np.median(part)))) for part in np.split(logs, [cut])]
    if max(apart) > SPREAD * gaps.max():
        return {}
    return {name: int(i >= cut) for i, name in enumerate(names)}


def with_cameras(database: Path, lenses: Mapping[str, int]) -> Path:
    """A copy of a database in which photos of one lens share a camera; those without a number are of the first."""
    pycolmap = load_pycolmap()
    copy = database.with_name(f"{len(set(lenses.values()))}_lenses.db")
    shutil.copy(database, copy)
    with pycolmap.Database.open(copy) as opened:
        images = opened.read_all_images()
        first = opened.read_camera(images[0].camera_id)
        opened.clear_frames()
        opened.clear_rigs()
        for number in sorted(set(lenses.values())):
            camera = pycolmap.Camera(first.todict() | {"camera_id": first.camera_id + 1 + number})
            opened.write_camera(camera, use_camera_id=True)
            rig = pycolmap.Rig(rig_id=number + 1)
            rig.add_ref_sensor(camera.sensor_id)
            opened.write_rig(rig, use_rig_id=True)
        for image in images:
            number = lenses.get(image.name, 0)
            image.camera_id = first.camera_id + 1 + number
            frame = pycolmap.Frame(frame_id=image.image_id, rig_id=number + 1)
            frame.add_data_id(image.data_id)
            opened.write_frame(frame, use_frame_id=True)
            opened.update_image(image)
    return copy
