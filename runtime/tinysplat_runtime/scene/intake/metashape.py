"""Cameras that Agisoft Metashape exports as `.xml` ("Export Cameras").

A camera's transform leads from the camera, whose axes are OpenCV's, to its chunk, of which a component has the scale:
lengths are metres where that is known. Components are not aligned to each other, so the largest is read. Distortion is
of X/Z and Y/Z, or of the angle in fisheyes: k1 to k4 by even powers of the radius, p1 and p2 in the reverse of
OpenCV's order; b1 is fx − fy and b2 a skew, which is taken out as distortion is. Source: Agisoft Metashape User
Manual, appendix C, "Camera models".

Trust boundary: documents with a type or entities of their own are refused before they are parsed.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

from ...errors import InputError, warn, within
from ...system.files import parsing, read_limited
from ..cameras import posed
from ..lenses import Lens, brown_lens, opencv_lens
from ..scenes import MAX_CAMERAS_BYTES
from .tracked import Track, Tracked, number, numbers

SIGN = rb"<document\b[^>]*>\s*(<\w+[^>]*/>\s*)*<chunk\b"

_UNREAD = ("k5", "k6", "p3", "p4")
_TYPES = ("frame", "fisheye")
_HARDLY = 0.5  # pixels at the border that a term may move unread


def read_metashape(file: Path) -> Track:
    """The cameras of the largest component of the chunk with most of them.

    Raises:
        InputError: names the camera or sensor and its field.
    """
    data = read_limited(file, MAX_CAMERAS_BYTES)
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise InputError("declares a document type or entities, which Metashape does not")
    with parsing("XML"):
        root = ElementTree.fromstring(data)
    chunks = [_chunk(chunk, str(file)) for chunk in root.iter("chunk")]
    largest = max(chunks, key=lambda track: len(track.cameras), default=Track(()))
    if others := sum(len(chunk.cameras) for chunk in chunks) - len(largest.cameras):
        warn(f"{file}: {len(chunks)} chunks, of which the largest is read; {others} photos of others are left out")
    return largest


def _chunk(chunk: ElementTree.Element, file: str) -> Track:
    sensors = {sensor.get("id"): sensor for sensor in chunk.iter("sensor")}
    scales = {part.get("id"): part.find("transform/scale") for part in chunk.iter("component")}
    cameras = [camera for camera in chunk.iter("camera") if _text(camera.find("transform"))]
    parts = Counter(camera.get("component_id") for camera in cameras)
    if not parts:
        return Track(())
    (largest, count), *_ = parts.most_common()
    if len(parts) > 1:
        left = f"{len(cameras) - count} photos of others are left out"
        warn(f"{file}: {len(parts)} components, of which the largest is read; {left}")
    scale = number("component scale", _text(scales.get(largest)) or 1)
    tracked = []
    for camera in cameras:
        label = camera.get("label") or ""
        if camera.get("component_id") != largest or camera.get("enabled") in ("false", "0") or not label:
            continue
        if (sensor := sensors.get(camera.get("sensor_id"))) is None:
            raise InputError(f"{camera.get('sensor_id')}, which is none of the sensors", where=f"{label}.sensor_id")
        matrix = numbers(f"{label}.transform", _text(camera.find("transform")), 16).reshape(4, 4)
        pose = posed(matrix[:3, :3], scale * matrix[:3, 3])
        tracked.append(Tracked(label, pose, partial(_lens, sensor)))
    return Track(tracked)


def _text(element: ElementTree.Element | None) -> str:
    return (element.text or "").strip() if element is not None else ""


def _lens(sensor: ElementTree.Element, size: tuple[int, int]) -> Lens:
    name = f"sensor {sensor.get('label') or sensor.get('id')}"
    kind = sensor.get("type", "frame")
    if kind not in _TYPES:
        raise InputError(f"'{kind[:40]}', expected {' or '.join(_TYPES)}", where=f"{name}.type")
    calibrations = {found.get("class", "adjusted"): found for found in sensor.findall("calibration")}
    calibration = calibrations.get("adjusted", calibrations.get("initial"))
    if calibration is None:
        raise InputError("missing", where=f"{name}.calibration")
    value = _values(calibration, name)
    resolution = sensor.find("resolution")
    width, height = (
        (int(number(f"{name}.resolution.{side}", resolution.get(side))) for side in ("width", "height"))
        if resolution is not None
        else size[::-1]
    )
    for term in _UNREAD:
        if abs(value(term)) * max(width, height) > _HARDLY:
            raise InputError(f"{value(term):g}, which no camera here has: export without it", where=f"{name}.{term}")
    fx, fy = value("fx") or value("f") + value("b1"), value("fy") or value("f")
    centre = (width / 2 + value("cx"), height / 2 + value("cy"))
    radial, tangential = [value(f"k{n}") for n in range(1, 5)], (value("p2"), value("p1"))
    shear = value("b2") / fy if fy and abs(value("b2")) * height / 2 > _HARDLY * abs(fy) else 0.0
    with within(name):
        if kind == "fisheye":
            lens = opencv_lens((fx, fy), centre, [*radial, 0.0, 0.0, *tangential], (height, width), fisheye=True)
        else:
            lens = brown_lens((fx, fy), centre, radial, tangential, (height, width))
        return replace(lens, shear=shear)


def _values(calibration: ElementTree.Element, name: str) -> Callable[[str], float]:
    """What gives a field of a calibration, 0 where there is none."""

    def value(field: str) -> float:
        return number(f"{name}.{field}", _text(calibration.find(field)) or 0)

    return value
