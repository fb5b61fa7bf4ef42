"""What was found of photos' places, and how far it is to be believed.

A photo most of whose strong matches contradict its place (`contradicted`) was placed wrongly; places that the matches
hardly fix are uncertain (`uncertainty`); and without parallax, nothing shows depth (`parallax`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.scene.lenses import load_pycolmap

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


@dataclass(frozen=True)
class Placement:
    """What was found of photos' places.

    Attributes:
        model: the pycolmap.Reconstruction of most photos.
        others: numbers of photos of further models that do not join it, of those that it lacks.
        wrong: names of photos in the model whose matches contradict their places.
        uncertain: names of photos whose places may be off by more than `UNCERTAIN`, the most uncertain first.
        parallax: the median over points of the largest angle between two photos' rays to them, degrees.
    """

    model: Any
    others: tuple[int, ...]
    wrong: frozenset[str]
    uncertain: tuple[str, ...]
    parallax: float

    @property
    def right(self) -> frozenset[str]:
        """Names of photos in the model whose matches agree with their places."""
        return frozenset(image.name for image in self.model.images.values() if image.has_pose) - self.wrong

    @property
    def shows_depth(self) -> bool:
        """Whether the camera moved enough for that."""
        return self.parallax >= LEAST_PARALLAX and len(self.uncertain) < MOST_UNCERTAIN * len(self.right)

    def worth(self) -> tuple[int, int]:
        """What makes one of two placements of the same photos the better one."""
        return len(self.right), -len(self.uncertain)


def judged(models: Sequence[Any], database: Path, *, is_rig: bool = False) -> Placement | None:
    """The largest of some models, judged by the matches that gave them; None where there is none."""
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
    )


def contradicted(model: Any, database: Path) -> frozenset[str]:
    """Names of placed photos of whose strong pairs (`STRONG` matches or more) most contradict their places.

    A match agrees with two places if it lies near the epipolar line that they give (Hartley and Zisserman 2004, 9.2).
    The worst photo is left out first, since it also speaks against those that it was matched with.
    """
    pycolmap = load_pycolmap()
    placed = {i: image for i, image in model.images.items() if image.has_pose}
    verdicts: dict[int, dict[int, bool]] = {i: {} for i in placed}
    with pycolmap.Database.open(database) as opened:
        keys, geometries = opened.read_two_view_geometries()
        keypoints = {i: np.asarray(opened.read_keypoints(i))[:, :2].astype(np.float64) for i in placed}
    for key, geometry in zip(keys, geometries, strict=True):
        one, other = pycolmap.pair_id_to_image_pair(key)
        matches = np.asarray(geometry.inlier_matches)
        if one in placed and other in placed and len(matches) >= STRONG:
            some = matches[:: -(-len(matches) // _CHECKED)]
            points = keypoints[one][some[:, 0]], keypoints[other][some[:, 1]]
            verdicts[one][other] = verdicts[other][one] = _agrees(model, placed[one], placed[other], points)
    wrong: set[int] = set()
    while True:
        left = {i: [ok for j, ok in of.items() if j not in wrong] for i, of in verdicts.items() if i not in wrong}
        share = {i: 1 - sum(of) / len(of) for i, of in left.items() if of}
        worst = max(share, key=lambda i: (share[i], i), default=None)
        if worst is None or share[worst] <= 0.5:
            return frozenset(placed[i].name for i in wrong)
        wrong.add(worst)


def _agrees(model: Any, one: Any, other: Any, points: tuple[NDArray, NDArray]) -> bool:
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


def uncertainty(model: Any) -> dict[str, float]:
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


def parallax(model: Any) -> float:
    """The median over a model's points of the largest angle between two photos' rays to them, degrees."""
    centres = {i: image.projection_center() for i, image in model.images.items() if image.has_pose}
    widest = []
    for point in model.points3D.values():
        rays = np.stack([centres[seen.image_id] for seen in point.track.elements]) - point.xyz
        rays /= np.linalg.norm(rays, axis=1, keepdims=True).clip(1e-12)
        widest.append(float(np.degrees(np.arccos(np.clip((rays @ rays.T).min(), -1, 1)))))
    return float(np.median(widest)) if widest else 0.0
