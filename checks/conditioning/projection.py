"""VPT and its inverse on cases at the ends: far from the origin, near and far depths, lenses, rotations, scales.

Means are kept relative to a float64 origin and the camera's centre is two float32; of quaternions the largest
component is divided out first, and Quat(R) takes its branch. Nothing helps where an ulp of a float32 mean is as large
as an error: a principal point 1e4 px outside, a focal length of 1e6 px.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import mpmath
import numpy as np
import torch
from numpy.typing import NDArray

from tinysplat.measure.rows import Row
from tinysplat.reference.transforms import pixel_centres, project_view, unproject_view
from tinysplat.transforms import Synthesis, ViewProjection
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import matrices_to_quats, normalize_quats
from tinysplat_runtime.graphs.inference import CONTRACTS, GraphStore, as_input
from tinysplat_runtime.scene.cameras import Camera

from . import exact as E
from .exact import EPS32, EPS64, numeric_row

SIDE = 8
ROUNDINGS = 8
"""Roundings on the way to a channel, at most: three differences, a dot product of three, a division and a product."""


@dataclass(frozen=True)
class CameraGaussians:
    """Gaussians on the pixels of one camera, in float64.

    Attributes:
        means: (N, 3) world.
        origin: what float32 means are stored relative to.
        rotation: (3, 3) world to camera, exact.
    """

    name: str
    camera: Camera
    means: NDArray
    scales: NDArray
    quats: NDArray
    origin: NDArray
    rotation: NDArray[Any] = field(repr=False)

    def gaussians(self, origin: NDArray) -> Gaussians:
        """Gaussians (1, H, W) as float32 relative to an origin (3,) float64."""
        lead = (1, SIDE, SIDE)
        return Gaussians(
            (self.means - origin).reshape(*lead, 3),
            self.quats.reshape(*lead, 4),
            self.scales.reshape(*lead, 3),
            np.linspace(0, 1, SIDE * SIDE).reshape(lead),
            np.zeros((*lead, 1, 3)),
            (self.camera,),
            origin,
        )


def make_scene(
    name: str,
    *,
    distance: float = 0.0,
    depths: tuple[float, float] = (2.0, 4.0),
    K: NDArray | None = None,
    angle: Any = 0.3,
    scale: float = 1.0,
    quat_length: float = 1.0,
) -> CameraGaussians:
    """A scene whose camera stands `distance` from the world's origin and is turned by `angle`.

    Args:
        depths: least and largest z, spread logarithmically over the pixels.
        K: (3, 3) float64 intrinsics; None for an ordinary lens.
        scale: standard deviations in units of the pixel's footprint.
        quat_length: length of the quaternions.
    """
    rng = np.random.default_rng(7)
    lens = np.array([[9.0, 0, 4.1], [0, 9.5, 3.9], [0, 0, 1]]) if K is None else K
    turn = E.turn_of([0.3, 1.0, -0.2], mpmath.mpf(angle))
    R = E.rotation_matrices(turn)
    c2w = np.eye(4)
    c2w[:3, :3] = R.T.astype(np.float64)
    c2w[:3, 3] = distance * np.array([1.0, -0.7, 0.4]) + (0.3, 0.2, -0.1)
    camera = Camera(lens, c2w, SIDE, SIDE)
    z = np.geomspace(*depths, SIDE * SIDE)[rng.permutation(SIDE * SIDE)]
    uv = pixel_centres(SIDE, SIDE).reshape(-1, 2) + rng.uniform(-0.4, 0.4, (SIDE * SIDE, 2))
    rays = np.concatenate([uv, np.ones((len(uv), 1))], axis=-1) @ np.linalg.inv(lens).T
    means = (rays * z[:, None]) @ camera.rotation + camera.centre
    scales = scale * z[:, None] / camera.focal * rng.uniform(0.3, 1.5, (len(z), 3))
    quats = normalize_quats(rng.normal(size=(len(z), 4))) * quat_length
    origin = camera.centre.copy() if distance else np.zeros(3)
    return CameraGaussians(name, camera, means, scales, quats, origin, R)


def scenes() -> list[CameraGaussians]:
    """All cases."""

    def lens(focal: float, skew: float = 0.0, centre: tuple[float, float] = (4.1, 3.9)) -> NDArray:
        return np.array([[focal, skew, centre[0]], [0, 1.05 * focal, centre[1]], [0, 0, 1]])

    pi = mpmath.pi
    return [
        make_scene("ordinary"),
        make_scene("centred at 1e3", distance=1e3),
        make_scene("centred at 1e5", distance=1e5),
        make_scene("centred at 1e7", distance=1e7),
        make_scene("z of 1e-4", depths=(1e-4, 2e-4)),
        make_scene("z of 1e6", depths=(1e6, 2e6)),
        make_scene("far/near of 1e8", depths=(1e-2, 1e6)),
        make_scene("focal length 1e-2 px", K=lens(1e-2)),
        make_scene("focal length 1e6 px", K=lens(1e6)),
        make_scene("skew as large as the focal length", K=lens(9.0, 9.0)),
        make_scene("principal point 1e4 px outside", K=lens(9.0, 0.0, (-1e4, 1e4))),
        make_scene("rotation 0", angle=0),
        make_scene("rotation 1e-9", angle=1e-9),
        make_scene("rotation π − 1e-9", angle=pi - mpmath.mpf("1e-9")),
        make_scene("rotation π", angle=pi),
        make_scene("scales of 1e-12 footprints", scale=1e-12),
        make_scene("scales of 1e6 footprints", scale=1e6),
        make_scene("quaternions of length 1e-37", quat_length=1e-37),
        make_scene("quaternions of length 1e37", quat_length=1e37),
        make_scene("denormal quaternions", quat_length=1e-42),
    ]


# ---- VPT ------------------------------------------------------------------------------------------------------------


def camera_inputs(camera: Camera, *, invert: bool) -> dict[str, NDArray]:
    """A graph's camera tensors for one view: K and rotation (1, 3, 3), quaternion (1, 4), float32."""
    rotation = camera.rotation.T if invert else camera.rotation
    return {
        "K": as_input(camera.K)[None],
        "rotation": as_input(rotation)[None],
        "rotation_quat": as_input(matrices_to_quats(rotation))[None],
    }


def projection_inputs(g: Gaussians, *, split: bool = True) -> dict[str, NDArray]:
    """Inputs (1, …) of `analysis_vpt`; without `split`, the camera centre is rounded to one float32."""
    centre = g.cameras[0].centre - g.origin
    high = as_input(centre)
    low = as_input(centre - high) if split else np.zeros(3, np.float32)
    arrays = {name: getattr(g, name) for name in ("means", "quats", "scales", "opacities")}
    return {**arrays, **camera_inputs(g.cameras[0], invert=False), "centre_high": high[None], "centre_low": low[None]}


def run_projection(store: GraphStore, g: Gaussians) -> NDArray:
    """(11, N) float32 of the graph that ships."""
    return store.transform("analysis_vpt").run(projection_inputs(g))["geometry"][0].reshape(11, -1)


def run_plain(g: Gaussians) -> NDArray:
    """(11, N) of the formulas in float32, world means and centre rounded to float32."""
    inputs = projection_inputs(g, split=False)
    tensors = [torch.from_numpy(inputs[name]) for name in CONTRACTS["analysis_vpt"].inputs]
    tensors[1] = tensors[1] / tensors[1].norm(dim=-1, keepdim=True)  # as the formula says, without scaling first
    return ViewProjection()(*tensors)[0][0].numpy().reshape(11, -1)


def projection_rows(store: GraphStore) -> Iterator[Row]:
    """VPT: depth, offset, ŝ and rotation of every case."""
    for scene in scenes():
        stored, world = scene.gaussians(scene.origin), scene.gaussians(np.zeros(3))
        pixels = pixel_centres(SIDE, SIDE).reshape(-1, 2)
        K, rotation, centre = scene.camera.K, scene.rotation, scene.camera.centre
        true = E.project(E.exact(scene.means), scene.scales, K, rotation, centre, pixels)
        kept = E.exact(stored.means.reshape(-1, 3)) + E.exact(stored.origin)
        held = E.project(kept, stored.scales.reshape(-1, 3), K, rotation, centre, pixels)
        turn = E.exact(matrices_to_quats(scene.camera.rotation))
        held["quat"] = true["quat"] = E.multiply_quats(turn[None], E.unit_quats(stored.quats.reshape(-1, 4)))
        ways = {
            "plain": (run_plain(world), true),
            "ours": (run_projection(store, stored), held),
            "double": (project_view(stored, 0).reshape(11, -1), held),
        }
        yield from _projection_measures(scene, held, ways)


def _projection_measures(
    scene: CameraGaussians, held: dict[str, NDArray[Any]], ways: dict[str, tuple[NDArray, dict[str, NDArray[Any]]]]
) -> Iterator[Row]:
    z = held["depth"]
    reach = E.absolute(held["ray"]) @ E.absolute(scene.rotation.T)  # (N, 3): what the dot products sum up
    kappa = E.largest(reach[:, 2] / z)
    K = np.abs(scene.camera.K)
    pixels = E.largest((reach[:, 0] * K[0, 0] + reach[:, 1] * K[0, 1]) / z) + K[0, 2] + SIDE
    pixels = max(pixels, E.largest(reach[:, 1] * K[1, 1] / z) + K[1, 2] + SIDE) * max(kappa, 1.0)
    tiny = float(np.finfo(np.float32).tiny)
    least = float(min(E.absolute(held["scale"]).ravel()))
    bounds = {
        "depth": (kappa, ROUNDINGS * EPS32 * kappa, "relative"),
        "offset": (pixels, ROUNDINGS * EPS32 * pixels, "pixels"),
        "scale": (1 + kappa, ROUNDINGS * EPS32 * (1 + kappa) + 2 * tiny * EPS32 / max(least, tiny), "relative"),
        "quat": (1.0, ROUNDINGS * EPS32, "absolute"),
    }
    rows = {"depth": slice(0, 1), "offset": slice(1, 3), "scale": slice(3, 6), "quat": slice(6, 10)}
    for name, (condition, bound, unit) in bounds.items():
        errors = {}
        for way, (geometry, reference) in ways.items():
            wanted = reference[name].reshape(len(z), -1)
            values = geometry[rows[name]].T
            errors[way] = E.worst(values, wanted, wanted if unit == "relative" else 1.0)
        if name in _INTERESTING.get(scene.name, ("depth", "offset")):
            yield numeric_row("VPT", scene.name, f"{name}, {unit}", condition, **errors, bound=bound)


_INTERESTING = {
    "ordinary": ("depth", "offset", "scale", "quat"),
    **{f"rotation {a}": ("depth", "offset", "quat") for a in ("0", "1e-9", "π − 1e-9", "π")},
    **{f"scales of {a} footprints": ("scale",) for a in ("1e-12", "1e6")},
    "quaternions of length 1e-37": ("quat",),
    "quaternions of length 1e37": ("quat",),
    "denormal quaternions": ("quat",),
}

# ---- VPT⁻¹ ----------------------------------------------------------------------------------------------------------


def synthesis_inputs(geometry: NDArray, camera: Camera, centre: NDArray) -> dict[str, NDArray]:
    """Real-valued planes (11, N) through the integer graph, every pixel as a view of one pixel.

    The plane of ones then carries any value; the principal point moves so that pixel (0, 0) is the one meant.
    """
    n = geometry.shape[1]
    K = np.repeat(camera.K[None], n, axis=0)
    K[:, 0, 2] -= np.tile(np.arange(camera.width), camera.height)
    K[:, 1, 2] -= np.repeat(np.arange(camera.height), camera.width)
    rotation = camera.rotation.T
    return {
        "geometry_codes": np.ones((n, 1, 1, 1), np.uint16),
        "geometry_mix": as_input(geometry.T)[..., None],
        "color_codes": np.ones((n, 1, 1, 1), np.uint16),
        "color_mix": np.zeros((1, 3), np.float32),
        "K": as_input(K),
        "rotation": as_input(np.repeat(rotation[None], n, axis=0)),
        "rotation_quat": as_input(np.repeat(matrices_to_quats(rotation)[None], n, axis=0)),
        "centre": as_input(np.repeat(centre[None], n, axis=0)),
        "inverse_depth": np.array(0, np.float32),
        "relative_rotation": np.array(0, np.float32),
        "depth_limits": as_input([1e-30, 1e30]),
    }


def inverse_rows(store: GraphStore) -> Iterator[Row]:
    """VPT⁻¹: how far means move, in units of their depth, and scales, relative."""
    for scene in scenes()[:15]:
        camera, centre = scene.camera, scene.camera.centre
        planes = project_view(scene.gaussians(scene.origin), 0).reshape(11, -1)
        geometry = planes.astype(np.float32)
        pixels = pixel_centres(SIDE, SIDE).reshape(-1, 2)
        wanted = E.unproject(geometry[0], geometry[1:3].T, geometry[3:6].T, camera.K, scene.rotation, pixels)
        near, far = centre - scene.origin, centre
        inputs = synthesis_inputs(geometry, camera, near)
        plain_inputs = synthesis_inputs(geometry, camera, far)
        tensors = [torch.from_numpy(plain_inputs[name]) for name in CONTRACTS["synthesis"].inputs]
        double = unproject_view(geometry.astype(np.float64).reshape(11, SIDE, SIDE), camera, scene.origin)
        ways = {
            "plain": (Synthesis()(*tensors)[0].numpy().reshape(-1, 3), far),
            "ours": (store.transform("synthesis").run(inputs)["means"].reshape(-1, 3), near),
            "double": (double["means"].reshape(-1, 3), near),
        }
        z = E.exact(geometry[0])[:, None]
        errors = {
            way: E.largest((E.exact(values) - E.exact(shift) - wanted["means"]) / z)
            for way, (values, shift) in ways.items()
        }
        K = np.abs(camera.K)
        slope = [(SIDE + K[1, 2]) / K[1, 1]]
        slope.append((SIDE + K[0, 2] + K[0, 1] * slope[0]) / K[0, 0])
        condition = 1 + sum(slope) + float(np.abs(near).sum() / geometry[0].min())
        yield numeric_row(
            "VPT⁻¹", scene.name, "means, in depths", condition, **errors, bound=ROUNDINGS * EPS32 * condition
        )


# ---- Quat(R) --------------------------------------------------------------------------------------------------------


def rotation_rows() -> Iterator[Row]:
    """Quaternions of rotation matrices at angles where one of the four branches loses its digits."""
    angles = [
        ("0", 0),
        ("1e-9", "1e-9"),
        ("1", "1"),
        ("π − 1e-3", mpmath.pi - mpmath.mpf("1e-3")),
        ("π − 1e-9", mpmath.pi - mpmath.mpf("1e-9")),
        ("π", mpmath.pi),
    ]
    for name, angle in angles:
        wanted = E.turn_of([0.3, 1.0, -0.2], mpmath.mpf(angle))
        matrix = E.rotation_matrices(wanted).astype(np.float64)
        ways = {
            "plain": _trace_quat(matrix.astype(np.float32)),
            "ours": matrices_to_quats(matrix),
            "double": _trace_quat(matrix),
        }
        errors = {way: min(E.worst(s * q.astype(np.float64), wanted) for s in (1, -1)) for way, q in ways.items()}
        yield numeric_row(
            "Quat(R)", f"rotation by {name}", "quaternion, absolute", 1.0, **errors, bound=ROUNDINGS * EPS64
        )


def _trace_quat(m: NDArray) -> NDArray:
    """The textbook branch alone: w from the trace, the vector divided by it."""
    with np.errstate(all="ignore"):
        w = np.sqrt(1 + np.trace(m)) / 2
        vector = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]) / (4 * w)
    return np.array([w, *vector])
