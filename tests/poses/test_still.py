"""What stands still in all photos is found where it is, and nothing is in photos where all moves."""

from pathlib import Path

import numpy as np
from poses.walls import HEIGHT, WIDTH, write_photos_of_walls

from tinysplat.poses.placing import place
from tinysplat.poses.still import still_masks
from tinysplat_runtime.scene.images import read_image
from tinysplat_runtime.scene.pictures import write_png

NAMES = [f"{i}.png" for i in range(9)]
TITLE = np.s_[200:216, 20:150]


def test_a_title_is_left_out_and_places_are_as_without_it(tmp_path: Path) -> None:
    cameras = write_photos_of_walls(tmp_path / "photos", views=9)
    assert still_masks(tmp_path / "photos", NAMES, tmp_path / "masks") == ({}, "")
    letters = np.kron(np.random.default_rng(0).integers(0, 2, (8, 65, 1)), np.full((2, 2, 3), 255)).astype(np.uint8)
    for name in NAMES:
        photo = read_image(tmp_path / "photos" / name).copy()
        photo[TITLE] = letters
        write_png(tmp_path / "photos" / name, photo)
    masks, where = still_masks(tmp_path / "photos", NAMES, tmp_path / "masks")
    counts = masks["4.png"].kept(HEIGHT, WIDTH) > 0
    assert where == "left, bottom" and counts[TITLE].mean() < 0.1 and counts[:180].all() and counts.mean() > 0.8
    found = place(tmp_path / "photos", NAMES, tmp_path, 1).model.images.values()
    centres = np.stack([image.projection_center() for image in sorted(found, key=lambda image: image.name)])
    truth = np.stack([camera.centre for camera in cameras])
    steps, true_steps = (np.linalg.norm(np.diff(places, axis=0), axis=1) for places in (centres, truth))
    np.testing.assert_allclose(steps / steps.mean(), true_steps / true_steps.mean(), rtol=0.05)
