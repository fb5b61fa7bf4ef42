"""Photos placed in space by COLMAP's incremental mapper, through the package pycolmap (extra `poses`).

Up to `FEW` photos are compared each with each. More photos are compared with those taken shortly before and with those
that share most of their largest features, which tell in half a millisecond what a comparison tells in thirty. Where
that leaves a photo out, up to `MORE` are compared again, with more partners and more carefully: features are matched
along epipolar lines as well, and fewer matches suffice for a place. A walk that comes back to where it was closes only
by pairs that no order tells of, and without them halves of a scene hang together by one pair and lie apart.

Matches then judge what was found: a photo most of whose strong matches contradict its place (`contradicted`) was placed
wrongly, and is left out.
"""

from __future__ import annotations

import hashlib
import itertools
import math
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.heic import SUFFIXES as HEIC
from tinysplat_runtime.scene.images import image_size, is_turned, read_image
from tinysplat_runtime.scene.lenses import load_pycolmap
from tinysplat_runtime.scene.pictures import jpeg_bytes, png_bytes
from tinysplat_runtime.system.jsonfields import JsonObject
from tinysplat_runtime.system.told import NOBODY, Told

MASKS = "masks"
"""Folder of masks beside that of photos."""

FEW, MORE = 40, 100
"""Photos that are compared each with each, and those that are compared again where some of them could not be placed."""

SMALL_SIDE = 800
"""Photos of at most so many pixels across have their features found in a picture twice as large."""

T = TypeVar("T")

_PHOTOS_AT_ONCE, _PAIRS_AT_ONCE = 8, 64  # that COLMAP is given, which does not say how far it is
_FEW_PLACES = 12  # of a rig's, each compared with each
_MATCHING, _CAREFULLY = "matching pairs of photos", "matching pairs of photos more carefully"
_PAIRS_A_PHOTO = 9  # of many photos, about
_NONE_PLACED = "no photos could be placed: they need texture, overlap, and to be taken from different places"
_SEED = 0  # of RANSAC: the same photos give the same poses
_OVERLAP = 6  # photos before each that it is compared with
_ALIKE, _MORE_ALIKE, _LARGEST = 10, 20, 256  # those that share most of so many features, at first and again
_DISTINCT = 0.8  # of the distance to the second nearest feature is a match's at most
_GROWTH = 1.4  # of many photos and points between two adjustments of all; 1.1, COLMAP's, takes half as long again
_FEWER_MATCHES = 20  # with points that suffice for a place on second thoughts, of COLMAP's 30
_SMALL_FEATURES, _FEATURES, _PIXELS = 4096, 2048, 1600  # of a photo; larger photos are shrunk to so many pixels first

STRONG, _CHECKED = 30, 200
"""Matches of a pair that say something about its places; the most that are looked at."""

_ON_LINE = 0.01  # of the picture's longer side: matches that lie so far from where places put them contradict these
_AGREE = 0.5  # of a pair's matches, that agree with its places where these are right

UNCERTAIN = 0.005
"""Of the places' extent: a place that is known no better is uncertain. Of 17 captures whose places are known, the three
wrong models had places of 0.7 % and more, the others of 0.26 % at most. Where a camera turns but hardly moves, parts of
its way are joined at scales that nothing says.
"""


ENOUGH = 2 / 3
"""Share of a video's frames, or of photos, that have to be placed."""

LEAST_PARALLAX, MOST_UNCERTAIN = 2.5, 0.5
"""Degrees between the directions in which most points are seen, and share of uncertain places, that a scene has."""


class NonePlacedError(InputError):
    """Photos of which not even two could be placed."""


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


def copies(photos: Path, names: Sequence[str]) -> dict[str, str]:
    """Photos that are byte for byte others, by name, and which they are."""
    first: dict[bytes, str] = {}
    first_of = {}
    for name in names:
        seen = first.setdefault(hashlib.sha256((photos / name).read_bytes()).digest(), name)
        if seen != name:
            first_of[name] = seen
    return first_of


def upright_copies(photos: Path, names: Sequence[str], folder: Path, told: Told = NOBODY) -> tuple[dict[str, str], int]:
    """Photos in a folder as a viewer shows them, by links where that is how they are stored; HEIC as JPEG.

    Returns:
        What each is called there, by name, and how many their Exif orientation turns.
    """
    called: dict[str, str] = {}
    turned = 0
    for name in told.progress("copying photos", names):
        stem, suffix = "_".join(Path(name).stem.split()), Path(name).suffix.lower()  # COLMAP's lists split at spaces
        is_heic = suffix in HEIC
        kind = ".jpg" if is_heic else suffix
        free = (f"{stem}{f'_{n}' if n > 1 else ''}{kind}" for n in itertools.count(1))
        copy = called[name] = next(one for one in free if not (folder / one).exists())
        if is_heic or is_turned(photos / name):
            turned += not is_heic
            (folder / copy).write_bytes(encoded(read_image(photos / name), copy))
            continue
        try:
            (folder / copy).symlink_to((photos / name).resolve())
        except OSError:  # a system without links
            shutil.copyfile(photos / name, folder / copy)
    return called, turned


def encoded(image: NDArray, name: str) -> bytes:
    """A picture (H, W, 3) uint8 as a file of the kind that a name says: PNG, or JPEG of the best quality."""
    return png_bytes(image) if Path(name).suffix.lower() == ".png" else jpeg_bytes(image, quantiser=2)


def place(
    photos: Path,
    names: Sequence[str],
    work: Path,
    threads: int,
    *,
    rig: Mapping[str, NDArray] | None = None,
    told: Told = NOBODY,
) -> Placement:
    """Find where photos were taken.

    Args:
        photos: their folder; they are as stored, whatever their Exif orientation.
        names: in the order in which they were taken, where that is known.
        work: an empty folder for what is found on the way, or that of a call with some of these photos, whose features
            and matches are used again. Where it has a folder `MASKS`, that has a picture for every photo, named as the
            photo is, with another `.png`, and black where no features count.
        rig: of photos `CAMERA/NAME`, those of one NAME were taken at one place: (3, 3) turns by CAMERA, from the axes
            of the first, which is level, to its own; all are square and see 90°.
        threads: of COLMAP, for features and matches; -1 for all cores. Places do not depend on them.
        told: is told how far it is.

    Raises:
        NonePlacedError: none could be placed.
    """
    pycolmap = load_pycolmap()
    database = work / "database.db"
    are_few = len(names) <= FEW
    every = [(i, j) for j in range(len(names)) for i in range(j)] if are_few else []
    height, width = image_size(photos / names[0])
    steps = ahead(len(names), len(every) if are_few else _PAIRS_A_PHOTO * len(names), height * width)
    told.plan(steps)
    _find_features(photos, names, database, threads, rig=rig, told=told)
    if rig:
        _match(names, _pairs_of_rig(names, rig), database, threads, told=told)
        found = _placed(photos, database, len(names), rig=rig, told=told)
        if found is None:
            raise NonePlacedError(_NONE_PLACED)
        return found
    shared = np.zeros((0, 0)) if are_few else shared_features(names, database, told)
    pairs = every or pairs_of_many(shared, _ALIKE)
    _match(names, pairs, database, threads, told=told)
    found = _placed(photos, database, len(names), told=told)
    is_whole = found is not None and len(found.right) == len(names) and (are_few or not found.uncertain)
    if len(names) <= MORE and not is_whole:
        with pycolmap.Database.open(database) as opened:
            opened.clear_matches()
            opened.clear_two_view_geometries()
        again_pairs = every or pairs_of_many(shared, _MORE_ALIKE)
        told.plan([(_CAREFULLY, 1.5 * len(again_pairs) / len(pairs) * dict(steps)[_MATCHING]), *steps[-2:]])
        _match(names, again_pairs, database, threads, is_careful=True, told=told)
        again = _placed(photos, database, len(names), is_careful=True, told=told)
        found = max((one for one in (again, found) if one is not None), key=Placement.worth, default=None)
    if found is None:
        raise NonePlacedError(_NONE_PLACED)
    return found


def ahead(photos: int, pairs: int, pixels: int) -> list[tuple[str, float]]:
    """Steps, and what each is likely to take against the others, for so many photos of so many pixels."""
    whole = pixels / 1e6
    seen = min(whole, 1.4)  # of larger photos, a smaller copy is
    choosing = [("choosing pairs of photos", 0.002 * photos**2)] if photos > FEW else []
    return [
        ("features of photos", photos * (0.06 + 0.3 * seen)),
        *choosing,
        (_MATCHING, pairs * (0.005 + 0.01 * seen)),
        ("placing photos", photos * (0.04 + 0.04 * seen)),
        ("taking distortion out", photos * (0.02 + 0.07 * whole)),
    ]


def _pairs_of_rig(names: Sequence[str], rig: Mapping[str, NDArray]) -> list[tuple[int, int]]:
    """Pairs of photos, lower index first, of places near in order: by the same camera, or level ones side by side."""
    number = {name: i for i, name in enumerate(names)}
    taken = [*dict.fromkeys(name.partition("/")[2] for name in names)]
    steps = {*range(1, len(taken) if len(taken) <= _FEW_PLACES else _OVERLAP + 1), *(1 << n for n in range(1, 7))}
    level = [name for name in rig if abs(rig[name][2][1]) < 0.5]
    beside = [(one, other) for one in level for other in level if abs(rig[one][2] @ rig[other][2]) < 0.5]
    beside += [(name, name) for name in rig]
    apart = [(i, i + step) for i in range(len(taken)) for step in sorted(steps) if i + step < len(taken)]
    named = ((f"{one}/{taken[i]}", f"{other}/{taken[j]}") for i, j in apart for one, other in beside)
    pairs = {(number[one], number[other]) for one, other in named if one in number and other in number}
    return sorted((min(pair), max(pair)) for pair in pairs)


def _find_features(
    photos: Path, names: Sequence[str], database: Path, threads: int, *, rig: Mapping[str, NDArray] | None, told: Told
) -> None:
    """Features of those photos that a database lacks."""
    pycolmap = load_pycolmap()
    sizes = {image_size(photos / name) for name in names}
    mode = pycolmap.CameraMode.SINGLE if len(sizes) == 1 else pycolmap.CameraMode.AUTO
    pycolmap.set_random_seed(_SEED)
    extraction = pycolmap.FeatureExtractionOptions(num_threads=threads, use_gpu=False)
    is_small = max(max(size) for size in sizes) <= SMALL_SIDE
    extraction.max_image_size = SMALL_SIDE if is_small else _PIXELS
    extraction.sift.max_num_features = _SMALL_FEATURES if is_small else _FEATURES
    extraction.sift.first_octave = -1 if is_small else 0
    reading = pycolmap.ImageReaderOptions()
    if (masks := database.with_name(MASKS)).is_dir():
        reading.mask_path = masks
    with pycolmap.Database.open(database) as opened:
        if opened.num_cameras() == 1 and len(sizes) == 1:
            reading.existing_camera_id = opened.read_all_cameras()[0].camera_id
        new = [name for name in names if not opened.exists_image(name)]
    if not new:
        return
    if rig:
        ((side, _),) = sizes
        mode, reading.camera_model, reading.camera_params = (
            pycolmap.CameraMode.PER_FOLDER,
            "PINHOLE",
            f"{side / 2}," * 3 + f"{side / 2}",
        )
        extraction.sift.max_num_features = _FEATURES
    # All photos first: they get numbers in their order, not in that in which threads are done with them.
    pycolmap.import_images(database, photos, mode, image_names=new, options=reading)
    for part in _by_parts(new, _PHOTOS_AT_ONCE, "features of photos", told):
        pycolmap.extract_features(database, photos, part, mode, reading, extraction)
    if rig:
        with pycolmap.Database.open(database) as opened:
            pycolmap.apply_rig_config([pycolmap.RigConfig(cameras=_sensors(rig))], opened)


def _sensors(rig: Mapping[str, NDArray]) -> list[Any]:
    """Cameras of a rig, the first of which the others are stated against."""
    pycolmap = load_pycolmap()
    sensors: list[Any] = []
    for name, turn in rig.items():
        sensor = pycolmap.RigConfigCamera(image_prefix=f"{name}/", ref_sensor=not sensors)
        if sensors:
            sensor.cam_from_rig = pycolmap.Rigid3d(pycolmap.Rotation3d(np.asarray(turn, np.float64)), np.zeros(3))
        sensors.append(sensor)
    return sensors


def _match(
    names: Sequence[str],
    pairs: Sequence[tuple[int, int]],
    database: Path,
    threads: int,
    *,
    is_careful: bool = False,
    told: Told,
) -> None:
    """Match and verify those pairs of photos that the database lacks."""
    pycolmap = load_pycolmap()
    matching = pycolmap.FeatureMatchingOptions(num_threads=threads, use_gpu=False, guided_matching=is_careful)
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = _SEED
    listed = database.with_name("pairs.txt")
    label = _CAREFULLY if is_careful else _MATCHING
    for part in _by_parts(pairs, _PAIRS_AT_ONCE, label, told):
        listed.write_text("".join(f"{names[i]} {names[j]}\n" for i, j in part), "utf-8")
        pairing = pycolmap.ImportedPairingOptions(match_list_path=listed)
        pycolmap.match_image_pairs(database, matching, pairing, verification)


def _by_parts(items: Sequence[T], size: int, label: str, told: Told) -> Iterator[Sequence[T]]:
    """Parts of so many items; tells how many of them all are done."""
    parts = [items[start : start + size] for start in range(0, len(items), size)]
    return told.progress(label, parts, total=len(items), size_of=len)


def _placed(
    photos: Path,
    database: Path,
    count: int,
    *,
    is_careful: bool = False,
    rig: Mapping[str, NDArray] | None = None,
    told: Told,
) -> Placement | None:
    """The largest model that matches of so many photos give, judged by them."""
    models = sorted(
        _mapped(photos, database, count, is_careful=is_careful, is_rig=bool(rig), told=told),
        key=lambda one: -one.num_reg_images(),
    )
    if not models:
        return None
    names = [{image.name for image in one.images.values() if image.has_pose} for one in models]
    model = models[0]
    known = {} if rig else uncertainty(model)  # COLMAP has no covariances of a rig's places
    loose = {name: off for name, off in known.items() if off > UNCERTAIN}
    return Placement(
        model,
        tuple(count for of_one in names[1:] if (count := len(of_one - names[0])) > 1),
        contradicted(model, database),
        tuple(sorted(loose, key=lambda name: -loose[name])),
        parallax(model),
    )


def parallax(model: Any) -> float:
    """The median over a model's points of the largest angle between two photos' rays to them, degrees."""
    centres = {i: image.projection_center() for i, image in model.images.items() if image.has_pose}
    widest = []
    for point in model.points3D.values():
        rays = np.stack([centres[seen.image_id] for seen in point.track.elements]) - point.xyz
        rays /= np.linalg.norm(rays, axis=1, keepdims=True).clip(1e-12)
        widest.append(float(np.degrees(np.arccos(np.clip((rays @ rays.T).min(), -1, 1)))))
    return float(np.median(widest)) if widest else 0.0


def shared_features(names: Sequence[str], database: Path, told: Told = NOBODY) -> NDArray:
    """(N, N) int64, of how many of their largest features two photos have each other's as their nearest by far."""
    with load_pycolmap().Database.open(database) as opened:
        numbers = [opened.read_image_with_name(name).image_id for name in names]
        largest = [_largest_features(opened, number) for number in numbers]
    shared = np.zeros((len(names), len(names)), np.int64)
    for j in told.progress("choosing pairs of photos", range(len(names)), costs=range(len(names))):
        for i in range(j):
            alike = largest[i] @ largest[j].T
            if min(alike.shape) > 1:
                nearest = alike.argmax(axis=1)
                second, first = np.partition(alike, -2, axis=1)[:, -2:].T
                is_distinct = 1 - first < _DISTINCT**2 * (1 - second)
                is_mutual = alike.argmax(axis=0)[nearest] == np.arange(len(nearest))
                shared[i, j] = shared[j, i] = np.count_nonzero(is_distinct & is_mutual)
    return shared


def _largest_features(database: Any, image: int) -> NDArray:
    """(n, 128) float32 unit vectors of a photo's features."""
    keypoints, descriptors = np.asarray(database.read_keypoints(image)), database.read_descriptors(image)
    sizes = np.hypot(keypoints[:, 2], keypoints[:, 4])  # the axes of an affine frame
    chosen = np.argsort(-sizes, kind="stable")[:_LARGEST]
    vectors = np.asarray(getattr(descriptors, "data", descriptors)).astype(np.float32)[chosen]  # an array before 4
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True).clip(1e-6)


def pairs_of_many(shared: NDArray, alike: int) -> list[tuple[int, int]]:
    """Pairs of photos, lower index first, that may show the same: near in order, or among the so many that share most
    features; `shared` is (N, N), see `shared_features`.
    """
    count = len(shared)
    pairs = {(i, j) for j in range(count) for i in range(max(j - _OVERLAP, 0), j)}
    for i, row in enumerate(shared):
        best = np.argsort(-row, kind="stable")[:alike].tolist()
        pairs |= {(min(i, j), max(i, j)) for j in best if row[j]}
    return sorted(pairs)


def _mapped(photos: Path, database: Path, count: int, *, is_careful: bool, is_rig: bool, told: Told) -> list[Any]:
    """The models that matches of so many photos give."""
    pycolmap = load_pycolmap()
    folder = tempfile.mkdtemp(dir=database.parent)
    # One thread: with more, sums are added up in another order in every run, and photos are placed or not by that.
    options = pycolmap.IncrementalPipelineOptions(num_threads=1, random_seed=_SEED, min_model_size=2)
    if is_rig:  # whose cameras are known
        options.ba_refine_focal_length = options.ba_refine_extra_params = options.ba_refine_sensor_from_rig = False
    if is_careful:
        options.mapper.abs_pose_min_num_inliers = _FEWER_MATCHES
    elif count > FEW:
        options.ba_global_frames_ratio = options.ba_global_points_ratio = _GROWTH
    with told.counting("placing photos", count) as another:
        models = pycolmap.incremental_mapping(
            database,
            photos,
            folder,
            options,
            initial_image_pair_callback=lambda: (another(), another()),
            next_image_callback=another,
        )
    return list(models.values())


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


def coloured_points(model: Any) -> tuple[NDArray, NDArray, NDArray]:
    """Points (N, 3) in the world, their colours (N, 3) uint8, and their errors (N,) in pixels."""
    points = list(model.points3D.values())
    return (
        np.array([point.xyz for point in points], np.float64).reshape(-1, 3),
        np.array([point.color for point in points], np.uint8).reshape(-1, 3),
        np.array([point.error for point in points], np.float64),
    )


def placed_photos(model: Any) -> tuple[list[JsonObject], NDArray]:
    """Photos that have a pose, and what they observe.

    Returns:
        A photo's `name`, `w2c` (3×4) and `camera` (model, params, width, height); and pairs (M, 2) int64 of an index
        into these and one into `coloured_points`.
    """
    points = {number: row for row, number in enumerate(model.points3D)}
    entries: list[JsonObject] = []
    observations: list[tuple[int, int]] = []
    for image in (image for image in model.images.values() if image.has_pose):
        camera = model.cameras[image.camera_id]
        seen = (point.point3D_id for point in image.points2D if point.has_point3D())
        observations += [(len(entries), points[number]) for number in seen if number in points]
        taken_with = {"model": camera.model.name, "params": [float(value) for value in camera.params]}
        taken_with |= {"width": int(camera.width), "height": int(camera.height)}
        pose = image.cam_from_world().matrix().tolist()
        entries.append({"name": image.name, "w2c": pose, "camera": taken_with})
    return entries, np.array(observations, np.int64).reshape(-1, 2)
