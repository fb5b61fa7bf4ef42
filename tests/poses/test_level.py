"""Photos that say which way things fell turn the world upright, however the phone was held."""

import numpy as np
import pytest
from scenes import tells

from tinysplat.poses.level import falling, upright
from tinysplat_runtime.render.paths import looking_along
from tinysplat_runtime.scene.cameras import posed

HELD = {  # the phone's right and top of its screen in a photo that is seen upright (x right, y down)
    "upright": ((1, 0), (0, -1)),
    "on its left": ((0, 1), (1, 0)),
    "on its right": ((0, -1), (-1, 0)),
    "on its head": ((-1, 0), (0, 1)),
}


def stated(seen: np.ndarray, how: str) -> tuple[float, float, float]:
    """What a phone writes of gravity that is `seen` so in its photo."""
    right, top = HELD[how]
    return float(seen[:2] @ right), float(seen[:2] @ top), float(-seen[2])


@pytest.mark.parametrize("how", HELD)
def test_a_photo_shows_which_way_things_fell_however_the_phone_was_held(how: str) -> None:
    for seen in ((0, 1, 0), (0.1, 0.9, 0.42), (-0.3, 0.9, -0.3), (0.05, 0.55, 0.83)):
        unit = np.array(seen) / np.linalg.norm(seen)
        np.testing.assert_allclose(falling(*stated(unit, how)), unit, atol=1e-12)
    for unclear in ((0, 0, 1.0), (0.7, 0.7, 0), (0, 0.1, 0.2)):  # flat, diagonal, shaken
        assert falling(*stated(np.array(unclear), how)) is None


def test_the_world_stands_as_photos_of_a_line_say() -> None:
    world, entries, gravity = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0], [], {}
    world *= np.linalg.det(world)
    lens = {"model": "PINHOLE", "width": 32, "height": 24, "params": [30.0, 30.0, 16.0, 12.0]}
    for number, how in enumerate(HELD):
        R = looking_along(np.array([0, 0.3 + 0.1 * number, 1]), np.array([0.0, 1, 0]))
        name, c2w = f"{number}.jpg", posed(world @ R, world @ [number, 0, 0])
        entries.append({"name": name, "w2c": np.linalg.inv(c2w)[:3].tolist(), "camera": lens})
        gravity[name] = stated(R.T @ [0, 1, 0], how)
    points = np.random.default_rng(1).normal((0, 0, 4), 1, (200, 3))
    placed, _, level = upright(entries, points @ world.T, gravity)
    assert level.is_sure and tells(level.evidence, "4 gravity")
    for entry in placed:
        np.testing.assert_allclose(np.array(entry["w2c"])[0, 1], 0, atol=1e-9)  # x axes lie level
        assert np.array(entry["w2c"])[1, 1] > 0.8  # and down is down
    assert not upright(entries, points @ world.T, {})[2].is_sure
