"""What was found of photos' places, and how far it is to be believed.

A photo most of whose strong matches contradict its place (`contradicted`) was placed wrongly; places that the matches
hardly fix are uncertain (`uncertainty`); without parallax, nothing shows depth (`parallax`); and where a camera that
only turned or zoomed explains the matches as well (`only_turns`), a wrong focal length makes the parallax.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.scene.lenses import load_pycolmap
from tinysplat_runtime.system.evenly import evenly

if TYPE_CHECKING:
    from pycolmap import Image, Reconstruction

STRONG, _CHECKED = 30, 200
"""Matches of a pair that say something about its places; the most that are looked at."""

_ON_LINE = 0.01  # of the picture's longer side: matches that lie so far from where places put them contradict these
_AGREE = 0.5  # of a pair's matches, that agree with its places where these are right

UNCERTAIN = 0.005
"""Of the places' extent: a place that is known no better is uncertain. Of 17 captures whose places are known, the three
wrong models had places of 0.7 % and more, the others of 0.26 % at most. Where a camera turns but hardly moves, parts of
its way are joined at scales that nothing says.
"""

LEAST_PARALLAX, MOST_UNCERTAIN = 2.5, 0.5
"""Degrees between the directions in which most points are seen, and share of uncertain places, that a scene has."""

FOCALS = np.geomspace(0.4, 3.0, 50)
"""Focal lengths that a camera that only turns is tried with, of the picture's longer side."""

ZOOMS = 1 + np.linspace(-0.06, 0.06, 25)
"""Changes of focal length from photo to photo, beside that of how far apart the matches are."""

TURNED, TURNED_PAIRS, NO_WORSE = 0.9, 2 / 3, 2.5
"""Of a pair's matches, that a turn has to explain; of pairs, that turns explain where the camera only turned; times
what a homography leaves, that such a turn may leave: views of a plane have one, but mostly of no turn."""

_PLAIN = (4, 5, 6)  # COLMAP's TwoViewGeometryConfiguration: PLANAR, PANORAMIC, or one of these
_MOVED, _MOST_PAIRS = (
    0.02,
    60,
)  # of the longer side that matches moved, in pairs that tell; and pairs that are looked at


@dataclass(frozen=True)
class Placement:
    """What was found of photos' places.

    Attributes:
        model: of most photos.
        others: numbers of photos of further models that do not join it, of those that it lacks.
        wrong: names of photos in the model whose matches contradict their places.
        uncertain: names of photos whose places may be off by more than `UNCERTAIN`, the most uncertain first.
        parallax: the median over points of the largest angle between two photos' rays to them, degrees.
        only_turns: whether a camera that only turned or zoomed explains the matches as well.
    """

    model: Reconstruction
    others: tuple[int, ...]
    wrong: frozenset[str]
    uncertain: tuple[str, ...]
    parallax: float
    only_turns: bool = False

    @property
    def right(self) -> frozenset[str]:
        """Names of photos in the model whose matches agree with their places."""
        return frozenset(image.name for image in self.model.images.values() if image.has_pose) - self.wrong

    @property
    def shows_depth(self) -> bool:
        """Whether the camera moved enough for that."""
        is_certain = len(self.uncertain) < MOST_UNCERTAIN * len(self.right)
        return self.parallax >= LEAST_PARALLAX and is_certain and not self.only_turns

    def worth(self) -> tuple[int, int]:
        """What makes one of two placements of the same photos the better one."""
        return len(self.right), -len(self.uncertain)


def judged(models: Sequence[Reconstruction], database: Path, off: float, *, is_rig: bool = False) -> Placement | None:
    """The largest of some models, judged by the matches that gave them, of features that lie `off` by so many pixels at
    most; None where there is none.
    """
    models = sorted(models, key=lambda one: -one.num_reg_images())
    if not models:
        return None
    names = [{image.name for image in one.images.values() if image.has_pose} for one in models]
    model = models[0]
    known = {} if is_rig else uncertainty(model)  # COLMAP has no covariances of a rig's places
    loose = {name: off for name, off in known.items() if off > UNCERTAIN}
    return Placement(
        model,
        tuple(count for of_one in names[1:] if (count := len(of_one - names[0])) > 1),
        contradicted(model, database),
        tuple(sorted(loose, key=lambda name: -loose[name])),
        parallax(model),
        not is_rig and only_turns(model, database, off),
    )


def only_turns(model: Reconstruction, database: Path, off: float) -> bool:
    """Whether a camera that turns and zooms at one place explains the strong pairs of a model's photos.

    Their matches, which lie `off` by so many pixels at most, are then those of a homography K' R K⁻¹ (Hartley and
    Zisserman 2004, 8.4), of one focal length but for zooms.
    """
    pairs = []
    for one, other, (here, there), is_plain in _strong_pairs(model, database):
        camera = model.cameras[one.camera_id]
        side, middle = max(camera.width, camera.height), np.array([camera.width, camera.height]) / 2
        other_camera = model.cameras[other.camera_id]
        here, there = here - middle, there - np.array([other_camera.width, other_camera.height]) / 2
        if np.median(np.linalg.norm(there - here, axis=1)) > _MOVED * side:
            pairs.append((side, here, there, is_plain))
    weights = [len(here) for _, here, *_ in pairs]  # what looks alike by chance does so with few matches
    if not pairs or np.average([is_plain for *_, is_plain in pairs], weights=weights) < TURNED_PAIRS:
        return False
    pairs = [pairs[i] for i in evenly(len(pairs), _MOST_PAIRS)]
    left = [_left_by_turns(*pair[:3]) for pair in pairs]  # (F, M) each
    common = int(np.argmin(np.sum([np.median(each, axis=1) for each in left], axis=0)))
    explained = []
    for each, (_, here, there, _) in zip(left, pairs, strict=True):
        least = NO_WORSE * np.median(_left_by_homography(here, there)) + off / 20
        focals = {common, int(np.argmin(np.median(each, axis=1)))} - {0, len(FOCALS) - 1}  # long ones turn hardly
        explained.append(any((each[f] < off).mean() >= TURNED and np.median(each[f]) <= least for f in focals))
    return bool(np.average(explained, weights=[len(here) for _, here, *_ in pairs]) >= TURNED_PAIRS)


def _strong_pairs(
    model: Reconstruction, database: Path
) -> Iterator[tuple[Image, Image, tuple[NDArray, NDArray], bool]]:
    """Placed photos with `STRONG` matches or more, (M, 2) and (M, 2) places of some of these, pixels, and whether one
    homography explains most.
    """
    pycolmap = load_pycolmap()
    placed = {i: image for i, image in model.images.items() if image.has_pose}
    with pycolmap.Database.open(database) as opened:
        keys, geometries = opened.read_two_view_geometries()
        keypoints = {i: np.asarray(opened.read_keypoints(i))[:, :2].astype(np.float64) for i in placed}
    for key, geometry in zip(keys, geometries, strict=True):
        one, other = pycolmap.pair_id_to_image_pair(key)
        matches = np.asarray(geometry.inlier_matches)
        if one in placed and other in placed and len(matches) >= STRONG:
            some = matches[:: -(-len(matches) // _CHECKED)]
            is_plain = int(geometry.config) in _PLAIN
            yield placed[one], placed[other], (keypoints[one][some[:, 0]], keypoints[other][some[:, 1]]), is_plain


def _left_by_turns(side: int, here: NDArray, there: NDArray) -> NDArray:
    """(F, M) pixels that turns leave between matches (M, 2) and (M, 2) from the middles of two photos, for each of
    `FOCALS` with the zoom that leaves least.
    """
    spread = math.sqrt(np.var(there, axis=0).sum() / max(np.var(here, axis=0).sum(), 1e-9))
    zooms = np.array([1.0, *(spread * ZOOMS)])[:, None, None]
    return np.stack([min(_left_by_turn(here, there, side * f, side * f * zooms), key=np.median) for f in FOCALS])


def _left_by_turn(here: NDArray, there: NDArray, focal: float, focal_there: NDArray) -> NDArray:
    """(Z, M) pixels that the best turn leaves, of a focal length and several (Z, 1, 1) of the other photo, pixels."""
    count = (len(focal_there), len(there), 1)
    rays = np.hstack([here / focal, np.ones((len(here), 1))])
    rays_there = np.concatenate([there / focal_there, np.ones(count)], axis=2)
    rays_there = rays_there / np.linalg.norm(rays_there, axis=2, keepdims=True)
    u, _, v = np.linalg.svd(np.swapaxes(rays_there, 1, 2) @ (rays / np.linalg.norm(rays, axis=1, keepdims=True)))
    u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]  # Kabsch 1976: the rotation nearest to it
    seen = rays @ np.swapaxes(u @ v, 1, 2)
    left: NDArray = np.linalg.norm(focal_there * seen[..., :2] / seen[..., 2:].clip(1e-6) - there, axis=2)
    return left


def _left_by_homography(here: NDArray, there: NDArray) -> NDArray:
    """(M,) pixels that the homography leaves which fits matches best by the linear method (ibid., 4.1)."""
    scale = max(float(np.abs(here).max()), float(np.abs(there).max()), 1.0)
    p, q = (np.hstack([places / scale, np.ones((len(places), 1))]) for places in (here, there))
    zero = np.zeros_like(p)
    rows = np.concatenate([np.hstack([p, zero, -q[:, :1] * p]), np.hstack([zero, p, -q[:, 1:2] * p])])
    seen = p @ np.linalg.svd(rows)[2][-1].reshape(3, 3).T
    left: NDArray = scale * np.linalg.norm(seen[:, :2] / seen[:, 2:] - q[:, :2], axis=1)
    return left


def contradicted(model: Reconstruction, database: Path) -> frozenset[str]:
    """Names of placed photos of whose strong pairs (`STRONG` matches or more) most contradict their places.

    A match agrees with two places if it lies near the epipolar line that they give (Hartley and Zisserman 2004, 9.2).
    The worst photo is left out first, since it also speaks against those that it was matched with.
    """
    placed = {i: image for i, image in model.images.items() if image.has_pose}
    verdicts: dict[int, dict[int, bool]] = {i: {} for i in placed}
    for one, other, points, _ in _strong_pairs(model, database):
        agrees = _agrees(model, one, other, points)
        verdicts[one.image_id][other.image_id] = verdicts[other.image_id][one.image_id] = agrees
    wrong: set[int] = set()
    while True:
        left = {i: [ok for j, ok in of.items() if j not in wrong] for i, of in verdicts.items() if i not in wrong}
        share = {i: 1 - sum(of) / len(of) for i, of in left.items() if of}
        worst = max(share, key=lambda i: (share[i], i), default=None)
        if worst is None or share[worst] <= 0.5:
            return frozenset(placed[i].name for i in wrong)
        wrong.add(worst)


def _agrees(model: Reconstruction, one: Image, other: Image, points: tuple[NDArray, NDArray]) -> bool:
    """Whether most matches (M, 2) and (M, 2), pixels, of two placed photos lie near their epipolar lines."""
    cameras = [model.cameras[image.camera_id] for image in (one, other)]
    first, second = (
        np.column_stack([camera.cam_from_img(seen), np.ones(len(seen))])
        for camera, seen in zip(cameras, points, strict=True)
    )
    (R1, t1), (R2, t2) = (np.split(image.cam_from_world().matrix(), [3], axis=1) for image in (one, other))
    R, t = R2 @ R1.T, (t2 - R2 @ R1.T @ t1)[:, 0]
    lines = np.cross(t / max(float(np.linalg.norm(t)), 1e-12), first @ R.T)  # (M, 3), in the other's picture
    away = np.abs((second * lines).sum(axis=1)) / np.hypot(lines[:, 0], lines[:, 1]).clip(1e-12)
    side = max(cameras[1].width, cameras[1].height) / cameras[1].mean_focal_length()
    return bool((away < _ON_LINE * side).mean() >= _AGREE)


def uncertainty(model: Reconstruction) -> dict[str, float]:
    """Standard deviation of each photo's place, by name, as a share of the places' extent.

    It follows from how far points are seen from where they should be, the mean over all sights. COLMAP's
    covariance of the poses holds three points fixed; what moves, turns or scales all places together says nothing about
    a scene and is taken out of it (Triggs et al. 2000, "Bundle adjustment", section 9).
    """
    pycolmap = load_pycolmap()
    images = [image for image in model.images.values() if image.has_pose]
    config = pycolmap.BundleAdjustmentConfig()
    for image in images:
        config.add_image(image.image_id)
    for camera in model.cameras:
        config.set_constant_cam_intrinsics(camera)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.THREE_POINTS)
    before_4 = pycolmap.create_default_bundle_adjuster
    adjuster = getattr(pycolmap, "create_default_ceres_bundle_adjuster", before_4)
    options = pycolmap.BACovarianceOptions(params=pycolmap.BACovarianceOptionsParams.POSES)
    covariance = pycolmap.estimate_ba_covariance(
        options, model, adjuster(pycolmap.BundleAdjustmentOptions(), config, model)
    )
    if covariance is None:
        return {image.name: math.inf for image in images}
    centres = np.stack([image.projection_center() for image in images])
    poses = [image.cam_from_world().matrix() for image in images]
    # A centre is -R^T t: what it moves by where the pose turns by w, from the left, and t moves.
    moves = [-pose[:, :3].T @ np.hstack([_cross(pose[:, 3]), np.eye(3)]) for pose in poses]
    count = len(images)
    spread = np.zeros((count, 3, count, 3))
    for i, one in enumerate(images):
        for j, other in enumerate(images[: i + 1]):
            block = covariance.get_cam_cross_cov_from_world(one.image_id, other.image_id)
            if block is None:  # nothing fixes one of them
                return {image.name: math.inf for image in images}
            spread[i, :, j] = moves[i] @ block @ moves[j].T
            spread[j, :, i] = spread[i, :, j].T
    away = centres - centres.mean(axis=0)
    together = np.stack([np.hstack([np.eye(3), -_cross(at), at[:, None]]) for at in away]).reshape(3 * count, 7)
    kept = np.eye(3 * count) - (basis := np.linalg.qr(together)[0]) @ basis.T
    variances = np.diagonal(kept @ spread.reshape(3 * count, 3 * count) @ kept).reshape(count, 3).sum(axis=1)
    extent = 2 * float(np.linalg.norm(away, axis=1).max())
    unit = model.compute_mean_reprojection_error() / extent
    return {image.name: unit * math.sqrt(max(float(v), 0.0)) for image, v in zip(images, variances, strict=True)}


def _cross(v: NDArray) -> NDArray:
    """The matrix (3, 3) of the cross product with v."""
    return np.cross(v, np.eye(3)).T


def parallax(model: Reconstruction) -> float:
    """The median over a model's points of the largest angle between two photos' rays to them, degrees."""
    centres = {i: image.projection_center() for i, image in model.images.items() if image.has_pose}
    widest = []
    for point in model.points3D.values():
        rays = np.stack([centres[seen.image_id] for seen in point.track.elements]) - point.xyz
        rays /= np.linalg.norm(rays, axis=1, keepdims=True).clip(1e-12)
        widest.append(float(np.degrees(np.arccos(np.clip((rays @ rays.T).min(), -1, 1)))))
    return float(np.median(widest)) if widest else 0.0
