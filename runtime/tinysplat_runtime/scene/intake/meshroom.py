"""Cameras of Meshroom: `.sfm`, AliceVision's JSON (`cameras.sfm` of its node StructureFromMotion).

Views name a photo, an intrinsic and a pose; a pose has its centre and the rotation into the camera column by column,
which read row by row leads out of it. Axes are OpenCV's. Focal lengths are pixels before version 1.2.2, then
millimetres of `sensorWidth`, with `pixelRatio` fx / fy before 1.2.5 and its inverse since; principal points count from
the middle since 1.2.1. Source: github.com/alicevision/AliceVision, src/aliceVision/sfmDataIO/jsonIO.cpp.
"""

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...system.files import read_limited
from ...system.jsonfields import parse_json
from ..cameras import posed
from ..lenses import Lens, opencv_lens
from .fields import Fields
from .tracked import Track, Tracked, number, numbers

SIGN = rb"\"version\""

_MAX_BYTES = 1 << 29  # with landmarks and observations
_DISTORTIONS = {
    "none": (), "pinhole": (), "radial1": ("k1",), "radialk1": ("k1",), "radial3": ("k1", "k2", "k3"),
    "radialk3": ("k1", "k2", "k3"), "brown": ("k1", "k2", "k3", "p1", "p2"), "fisheye": ("k1", "k2", "k3", "k4"),
    "fisheye4": ("k1", "k2", "k3", "k4"),
}  # fmt: skip
"""Parameters of each kind of distortion, in their order."""

_MOST_POINTS = 100_000


def read_meshroom(file: Path) -> Track:
    """The cameras and landmarks of such a file; InputError names the view or intrinsic and its field."""
    document = Fields(parse_json(read_limited(file, _MAX_BYTES)))
    version = tuple(int(part) for part in numbers("version", document.value("version", ["1", "0", "0"]), 3))
    intrinsics = {_key(entry, "intrinsicId"): entry for entry in document.each("intrinsics")}
    poses = {_key(entry, "poseId"): entry for entry in document.each("poses")}
    cameras = []
    for view in document.each("views"):
        name = view.values.get("path")
        if not isinstance(name, str) or not name or "\0" in name:
            raise InputError(f"{str(name)[:40]!r}, expected the name of a photo", where="views.path")
        if "rigId" in view.values:
            raise InputError("rigs of several cameras are not read: compute without", where=f"{name[-60:]}: rigId")
        pose, intrinsic = poses.get(_key(view, "poseId")), intrinsics.get(_key(view, "intrinsicId"))
        if pose is None or pose.values.get("pose") is None or intrinsic is None:
            continue  # a view that was not placed
        transform = pose.inside("pose").inside("transform").values
        rotation = numbers(f"{name[-60:]}: rotation", transform.get("rotation"), 9).reshape(3, 3)
        centre = numbers(f"{name[-60:]}: center", transform.get("center"), 3)
        cameras.append(Tracked(name, posed(rotation, centre), partial(_lens, intrinsic, version)))
    landmarks = document.each("structure")
    chosen = landmarks[:: max(1, len(landmarks) // _MOST_POINTS)]
    return Track(cameras, np.array([numbers("structure.X", one.values.get("X"), 3) for one in chosen]).reshape(-1, 3))


def _key(entry: Fields, name: str) -> str:
    """An identity, which is a number in some files and text in others."""
    return str(entry.values.get(name))[:40]


def _lens(entry: Fields, version: tuple[int, ...], size: tuple[int, int]) -> Lens:
    where = f"intrinsic {_key(entry, 'intrinsicId')}"
    entry = Fields(entry.values, where)
    width, height = (int(_number(entry, side)) for side in ("width", "height"))
    kind, name = entry.values.get("type", "pinhole"), "type"
    if kind == "pinhole" and "distortionType" in entry.values:
        kind, name = entry.values["distortionType"], "distortionType"
    if not isinstance(kind, str) or kind not in _DISTORTIONS:
        fault = f"{str(kind)[:40]!r}, expected one of {', '.join(_DISTORTIONS)}"
        raise InputError(fault, where=entry.place(name))
    terms = _DISTORTIONS[kind]
    given = _numbers(entry, "distortionParams", len(terms)) if terms else ()
    values = dict(zip(terms, given, strict=True))
    distortion = [float(values.get(term, 0.0)) for term in ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")]
    x, y = _numbers(entry, "principalPoint", 2)
    centre = (x, y) if version < (1, 2, 1) else (width / 2 + x, height / 2 + y)
    focal = _focal(entry, version, width)
    return opencv_lens(focal, centre, distortion, (height, width), fisheye=len(terms) == 4)


def _numbers(entry: Fields, name: str, count: int) -> NDArray:
    return numbers(entry.place(name), entry.values.get(name), count)


def _number(entry: Fields, name: str, default: float | None = None) -> float:
    return number(entry.place(name), entry.values.get(name, default))


def _focal(entry: Fields, version: tuple[int, ...], width: int) -> tuple[float, float]:
    """(fx, fy) in pixels."""
    if version < (1, 2, 0):
        fx = _number(entry, "pxFocalLength")
        return fx, fx
    if version < (1, 2, 2):
        fx, fy = _numbers(entry, "pxFocalLength", 2)
        return fx, fy
    sensor, ratio = _number(entry, "sensorWidth", 36), _number(entry, "pixelRatio", 1)
    if not sensor > 0 or not ratio > 0:
        where = entry.place("sensorWidth or pixelRatio")
        raise InputError(f"{min(sensor, ratio):g}, expected more than 0", where=where)
    fx = _number(entry, "focalLength") / sensor * width
    return fx, fx / ratio if version < (1, 2, 5) else fx * ratio
