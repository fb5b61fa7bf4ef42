"""Cameras of Meshroom: `.sfm`, AliceVision's JSON (`cameras.sfm` of its node StructureFromMotion).

Views name a photo, an intrinsic and a pose; a pose has its centre and the rotation into the camera column by column,
which read row by row leads out of it. Axes are OpenCV's. Focal lengths are pixels before version 1.2.2, then
millimetres of `sensorWidth`, with `pixelRatio` fx / fy before 1.2.5 and its inverse since; principal points count from
the middle since 1.2.1. Source: github.com/alicevision/AliceVision, src/aliceVision/sfmDataIO/jsonIO.cpp.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...system.files import read_limited
from ...system.jsonfields import JsonObject, kind_of, parse_object
from ..lenses import Lens, opencv_lens
from .tracked import Track, Tracked, number, numbers, posed

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
    """The cameras and landmarks of such a file.

    Raises:
        InputError: names the view or intrinsic and its field.
    """
    document = parse_object(read_limited(file, _MAX_BYTES))
    version = tuple(int(part) for part in numbers("version", document.get("version", ["1", "0", "0"]), 3))
    intrinsics = {_key(entry, "intrinsicId"): entry for entry in _objects(document, "intrinsics")}
    poses = {_key(entry, "poseId"): entry.get("pose") for entry in _objects(document, "poses")}
    cameras = []
    for view in _objects(document, "views"):
        name = view.get("path")
        if not isinstance(name, str) or not name or "\0" in name:
            raise InputError(f"{str(name)[:40]!r}, expected the name of a photo", where="views.path")
        if "rigId" in view:
            raise InputError("rigs of several cameras are not read: compute without", where=f"{name[-60:]}: rigId")
        pose, intrinsic = poses.get(_key(view, "poseId")), intrinsics.get(_key(view, "intrinsicId"))
        if pose is None or intrinsic is None:
            continue  # a view that was not placed
        transform = _object(_object(pose, "pose").get("transform"), "pose.transform")
        rotation = numbers(f"{name[-60:]}: rotation", transform.get("rotation"), 9).reshape(3, 3)
        centre = numbers(f"{name[-60:]}: center", transform.get("center"), 3)
        cameras.append(Tracked(name, posed(rotation, centre), partial(_lens, intrinsic, version)))
    landmarks = _objects(document, "structure")
    chosen = landmarks[:: max(1, len(landmarks) // _MOST_POINTS)]
    return Track(cameras, np.array([numbers("structure.X", one.get("X"), 3) for one in chosen]).reshape(-1, 3))


def _objects(document: JsonObject, name: str) -> list[JsonObject]:
    entries = document.get(name, [])
    if not isinstance(entries, list):
        raise InputError(f"a JSON {kind_of(entries)}, expected a list", where=name)
    return [_object(entry, f"{name}[{i}]") for i, entry in enumerate(entries)]


def _object(value: object, where: str) -> JsonObject:
    if not isinstance(value, dict):
        raise InputError(f"a JSON {kind_of(value)}, expected an object", where=where)
    return value


def _key(entry: JsonObject, name: str) -> str:
    """An identity, which is a number in some files and text in others."""
    return str(entry.get(name))[:40]


def _lens(entry: JsonObject, version: tuple[int, ...], size: tuple[int, int]) -> Lens:
    where = f"intrinsic {_key(entry, 'intrinsicId')}"
    width, height = (int(number(f"{where}.{side}", entry.get(side))) for side in ("width", "height"))
    kind, name = entry.get("type", "pinhole"), "type"
    if kind == "pinhole" and "distortionType" in entry:
        kind, name = entry["distortionType"], "distortionType"
    if not isinstance(kind, str) or kind not in _DISTORTIONS:
        fault = f"{str(kind)[:40]!r}, expected one of {', '.join(_DISTORTIONS)}"
        raise InputError(fault, where=f"{where}.{name}")
    terms = _DISTORTIONS[kind]
    values = (
        dict(zip(terms, numbers(f"{where}.distortionParams", entry.get("distortionParams"), len(terms)), strict=True))
        if terms
        else {}
    )
    distortion = [float(values.get(term, 0.0)) for term in ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")]
    x, y = numbers(f"{where}.principalPoint", entry.get("principalPoint"), 2)
    centre = (x, y) if version < (1, 2, 1) else (width / 2 + x, height / 2 + y)
    return opencv_lens(
        _focal(entry, version, width, where), centre, distortion, (height, width), fisheye=len(terms) == 4
    )


def _focal(entry: JsonObject, version: tuple[int, ...], width: int, where: str) -> tuple[float, float]:
    """(fx, fy) in pixels."""
    if version < (1, 2, 0):
        fx = number(f"{where}.pxFocalLength", entry.get("pxFocalLength"))
        return fx, fx
    if version < (1, 2, 2):
        fx, fy = numbers(f"{where}.pxFocalLength", entry.get("pxFocalLength"), 2)
        return fx, fy
    sensor = number(f"{where}.sensorWidth", entry.get("sensorWidth", 36))
    ratio = number(f"{where}.pixelRatio", entry.get("pixelRatio", 1))
    if not sensor > 0 or not ratio > 0:
        raise InputError(f"{min(sensor, ratio):g}, expected more than 0", where=f"{where}.sensorWidth or pixelRatio")
    fx = number(f"{where}.focalLength", entry.get("focalLength")) / sensor * width
    return fx, fx / ratio if version < (1, 2, 5) else fx * ratio
