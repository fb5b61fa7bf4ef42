"""Groups become one scene: every view from the group that keeps it, whatever origins the groups have."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scenes import make_gaussians, refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.network.predict import FAR_FROM_ORIGIN, NetworkLimits
from tinysplat_runtime.network.walk import capture_groups, predict_groups
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.neighbours import Group
from tinysplat_runtime.scene.scenes import Frame, Scene

NEAR, FAR = 1.5, 8.0
GROUPS = [Group((0, 1, 3), (0, 1)), Group((1, 2, 3), (2, 3))]


def scene_of(count: int, *, spacing: float = 0.2, shift: float = 0.0) -> Scene:
    """A row of cameras, without photos."""
    frames = []
    for v in range(count):
        c2w = np.eye(4)
        c2w[0, 3] = shift + spacing * v
        frames.append(Frame(Camera([[12, 0, 6], [0, 12, 4], [0, 0, 1]], c2w, 12, 8), Path(f"{v}.png")))
    return Scene(Path("capture"), tuple(frames), NEAR, FAR)


def marked(scene: Scene, origin: np.ndarray | None = None) -> Gaussians:
    """Gaussians of two layers, each view of whose means is its camera's x."""
    made = make_gaussians(len(scene.frames), 8, 12, layers=2, seed=len(scene.frames))
    origin = np.zeros(3) if origin is None else origin

    def layer(one: Gaussians) -> Gaussians:
        means = np.stack([np.full(one.means.shape[1:], c.centre[0] - origin[0]) for c in scene.cameras])
        return replace(one, means=means, cameras=one.cameras, extra_layers=(), origin=origin)

    behind = tuple(replace(layer(one), cameras=one.cameras) for one in made.extra_layers)
    return replace(layer(made), cameras=tuple(scene.cameras), extra_layers=behind)


def test_each_view_comes_from_the_group_that_keeps_it() -> None:
    scene, made = scene_of(4), list[Gaussians]()

    def run(views: Sequence[int]) -> Gaussians:
        made.append(marked(scene.views(views)))
        return made[-1]

    joined = predict_groups(scene.cameras, NEAR, GROUPS, run)
    assert joined.cameras == tuple(scene.cameras) and len(joined.layers) == 2
    for n, layer in enumerate(joined.layers):
        for view, (group, place) in enumerate([(0, 0), (0, 1), (1, 1), (1, 2)]):
            for name in FIELDS:
                np.testing.assert_array_equal(getattr(layer, name)[view], getattr(made[group].layers[n], name)[place])
            np.testing.assert_array_equal(layer.cameras[view].c2w, made[group].layers[n].cameras[place].c2w)
    Gaussians(**vars(joined))  # which checks


def test_groups_far_away_get_one_origin() -> None:
    shift = 10 * FAR_FROM_ORIGIN * NEAR
    scene = scene_of(4, shift=shift)

    def run(views: Sequence[int]) -> Gaussians:
        return marked(scene.views(views), scene.cameras[views[0]].centre)

    joined = predict_groups(scene.cameras, NEAR, GROUPS, run)
    found = joined.means[:, 0, 0, 0] + joined.origin[0]
    np.testing.assert_allclose(found, [camera.centre[0] for camera in scene.cameras], rtol=0, atol=1e-5)


def test_a_photo_without_partners_is_named() -> None:
    cameras, (away,) = scene_of(8).cameras, scene_of(1, shift=900).cameras
    with refusing(InputError, "photo 4 --views"):
        capture_groups([*cameras[:3], away, *cameras[4:]], NEAR, FAR, NetworkLimits())
    beyond = scene_of(1, shift=-900).cameras
    with refusing(InputError, "photo 4 and 1 --views"):
        capture_groups([*cameras[:3], away, *cameras[4:], *beyond], NEAR, FAR, NetworkLimits())
