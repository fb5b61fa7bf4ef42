"""Photos placed in space by COLMAP's incremental mapper, through the package pycolmap (extra `poses`).

Up to `FEW` photos are compared each with each, more by `pairs.py`. Where that leaves a photo out, up to `MORE` are
compared again, with more partners and more carefully: features are matched along epipolar lines as well, and fewer
matches suffice for a place. Matches then judge what was found (`judging.py`).
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.images import image_size
from tinysplat_runtime.scene.lenses import load_pycolmap
from tinysplat_runtime.scene.masks import Mask
from tinysplat_runtime.system.told import NOBODY, Told

from .judging import Placement, judged
from .lensing import focal_lengths, lenses_of, with_cameras
from .pairs import ALIKE, MORE_ALIKE, pairs_of_many, pairs_of_rig, shared_features

if TYPE_CHECKING:
    from pycolmap import Reconstruction, RigConfigCamera

MASKS = "masks"
"""Folder of masks beside that of photos."""

FEW, MORE = 40, 100
"""Photos that are compared each with each, and those that are compared again where some of them could not be placed."""

SMALL_SIDE = 800
"""Photos of at most so many pixels across have their features found in a picture twice as large."""

TOLERANCE, FINEST = 4.0, 1.5
"""Pixels that a feature may lie off, as COLMAP has them. In photos smaller than `SMALL_SIDE` so many times fewer, at
first, but not fewer than the second: what fits by chance moves focal lengths and places."""

T = TypeVar("T")

_PHOTOS_AT_ONCE, _PAIRS_AT_ONCE = 8, 64  # that COLMAP is given, which does not say how far it is
_MATCHING, _CAREFULLY = "matching pairs of photos", "matching pairs of photos more carefully"
_PAIRS_A_PHOTO = 9  # of many photos, about
_NONE_PLACED = "no photos could be placed: they need texture, overlap, and to be taken from different places"
_BETTER = 0.95  # of the error of one camera's model, that of several may have at most
_SEED = 0  # of RANSAC: the same photos give the same poses
_GROWTH = 1.4  # of many photos and points between two adjustments of all; 1.1, COLMAP's, takes half as long again
_FEWER_MATCHES = 20  # with points that suffice for a place on second thoughts, of COLMAP's 30
_SMALL_FEATURES, _FEATURES, _PIXELS = 4096, 2048, 1600  # of a photo; larger photos are shrunk to so many pixels first


class NonePlacedError(InputError):
    """Photos of which not even two could be placed."""


class Taken(NamedTuple):
    """Photos of a working folder, and where they were taken.

    Attributes:
        names: what messages call each, by its name there.
        masks: by that name; what a photo without one shows counts everywhere.
        placement: of those that could be placed.
        gravity: by that name, what `exif.gravity` says of photos that say it.
    """

    names: Mapping[str, str]
    masks: Mapping[str, Mask]
    placement: Placement
    gravity: Mapping[str, tuple[float, float, float]] = MappingProxyType({})


def place(
    photos: Path,
    names: Sequence[str],
    work: Path,
    threads: int,
    *,
    rig: Mapping[str, NDArray] | None = None,
    lenses: Mapping[str, object] = MappingProxyType({}),
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
        lenses: what tells photos of one lens and zoom from others', by name; those of one value have one camera.
            Without any, few photos are asked whether one lens fits them.
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
    off = max(TOLERANCE * min(1.0, max(height, width) / SMALL_SIDE), FINEST) if len(names) <= MORE else TOLERANCE
    steps = ahead(len(names), len(every) if are_few else _PAIRS_A_PHOTO * len(names), height * width)
    told.plan(steps)
    _find_features(photos, names, database, threads, rig=rig, lenses=lenses, told=told)
    if rig:
        _match(names, pairs_of_rig(names, rig), database, threads, off=off, told=told)
        found = _placed(photos, database, len(names), off=off, is_rig=True, told=told)
        if found is None:
            raise NonePlacedError(_NONE_PLACED)
        return found
    shared = np.zeros((0, 0)) if are_few else shared_features(names, database, told)
    pairs = every or pairs_of_many(shared, ALIKE)
    _match(names, pairs, database, threads, off=off, told=told)
    found = _placed(photos, database, len(names), off=off, told=told)
    if found and are_few and not lenses and len(found.model.cameras) == 1:
        told.plan(steps[-2:])
        database, found = _by_lenses(photos, names, database, found, off, told)

    def is_whole(one: Placement | None) -> bool:
        return one is not None and len(one.right) == len(names) and (are_few or not one.uncertain)

    if off < TOLERANCE and not is_whole(found):
        with pycolmap.Database.open(database) as opened:
            opened.clear_two_view_geometries()
        _match(names, pairs, database, threads, off=TOLERANCE, told=told)
        found = _better(_placed(photos, database, len(names), off=TOLERANCE, told=told), found)
    if len(names) <= MORE and not is_whole(found):
        with pycolmap.Database.open(database) as opened:
            opened.clear_matches()
            opened.clear_two_view_geometries()
        again_pairs = every or pairs_of_many(shared, MORE_ALIKE)
        told.plan([(_CAREFULLY, 1.5 * len(again_pairs) / len(pairs) * dict(steps)[_MATCHING]), *steps[-2:]])
        _match(names, again_pairs, database, threads, off=TOLERANCE, is_careful=True, told=told)
        found = _better(_placed(photos, database, len(names), off=TOLERANCE, is_careful=True, told=told), found)
    if found is None:
        raise NonePlacedError(_NONE_PLACED)
    return found


def _by_lenses(
    photos: Path, names: Sequence[str], database: Path, found: Placement, off: float, told: Told
) -> tuple[Path, Placement]:
    """The database and what was found in it, or with a camera for each of several lenses that the photos tell."""
    apart = with_cameras(database, {name: i for i, name in enumerate(names)})
    models = _mapped(photos, apart, len(names), off=off, told=told)
    focals = focal_lengths(max(models, key=lambda one: one.num_reg_images())) if models else {}
    if not (lenses := lenses_of(focals)):
        return database, found
    database_of_lenses = with_cameras(database, lenses)
    again = _placed(photos, database_of_lenses, len(names), off=off, told=told)
    if again is None or len(again.right) < len(found.right):
        return database, found
    one, several = (each.model.compute_mean_reprojection_error() for each in (found, again))
    return (database_of_lenses, again) if several < _BETTER * one else (database, found)


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


def _find_features(
    photos: Path,
    names: Sequence[str],
    database: Path,
    threads: int,
    *,
    rig: Mapping[str, NDArray] | None,
    lenses: Mapping[str, object],
    told: Told,
) -> None:
    """Features of those photos that a database lacks."""
    pycolmap = load_pycolmap()
    size_of = {name: image_size(photos / name) for name in names}
    sizes = set(size_of.values())
    mode = pycolmap.CameraMode.SINGLE
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
        known = [camera.camera_id for camera in opened.read_all_cameras()]
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
    cameras: dict[object, list[str]] = {}
    for name in new:
        cameras.setdefault(None if rig else (size_of[name], lenses.get(name)), []).append(name)
    if len(known) == len(cameras) == 1:
        reading.existing_camera_id = known[0]
    # All photos first: they get numbers in their order, not in that in which threads are done with them.
    for of_one in cameras.values():
        pycolmap.import_images(database, photos, mode, image_names=of_one, options=reading)
    for part in _by_parts(new, _PHOTOS_AT_ONCE, "features of photos", told):
        pycolmap.extract_features(database, photos, part, mode, reading, extraction)
    if rig:
        with pycolmap.Database.open(database) as opened:
            pycolmap.apply_rig_config([pycolmap.RigConfig(cameras=_sensors(rig))], opened)


def _sensors(rig: Mapping[str, NDArray]) -> list[RigConfigCamera]:
    """Cameras of a rig, the first of which the others are stated against."""
    pycolmap = load_pycolmap()
    sensors: list[RigConfigCamera] = []
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
    off: float,
    is_careful: bool = False,
    told: Told,
) -> None:
    """Match and verify those pairs of photos that the database lacks, of features that lie `off` by at most."""
    pycolmap = load_pycolmap()
    matching = pycolmap.FeatureMatchingOptions(num_threads=threads, use_gpu=False, guided_matching=is_careful)
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed, verification.ransac.max_error = _SEED, off
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
    photos: Path, database: Path, count: int, *, off: float, is_careful: bool = False, is_rig: bool = False, told: Told
) -> Placement | None:
    """The largest of the models that `_mapped` gives, judged; None where there is none."""
    models = _mapped(photos, database, count, off=off, is_careful=is_careful, is_rig=is_rig, told=told)
    return judged(models, database, off, is_rig=is_rig)


def _better(one: Placement | None, other: Placement | None) -> Placement | None:
    """The one of more worth; the first where both are worth the same."""
    return max((each for each in (one, other) if each is not None), key=Placement.worth, default=None)


def _mapped(
    photos: Path, database: Path, count: int, *, off: float, is_careful: bool = False, is_rig: bool = False, told: Told
) -> list[Reconstruction]:
    """The models that matches of so many photos give, of features that lie `off` by at most."""
    pycolmap = load_pycolmap()
    folder = tempfile.mkdtemp(dir=database.parent)
    # One thread: with more, sums are added up in another order in every run, and photos are placed or not by that.
    options = pycolmap.IncrementalPipelineOptions(num_threads=1, random_seed=_SEED, min_model_size=2)
    options.mapper.filter_max_reproj_error = options.mapper.init_max_error = off
    options.mapper.abs_pose_max_error = 3 * off
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
