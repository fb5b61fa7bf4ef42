"""Error against run time: every transform in plain float32, as it ships, and in float64, on 2×256×256 Gaussians."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tinysplat.measure.clock import Effort, Variant, measure
from tinysplat.measure.rows import Row
from tinysplat.reference.transforms import project_view
from tinysplat.transforms import Synthesis, ViewProjection
from tinysplat_runtime.codec.basis import reduce_basis, second_moment_weighting, view_directions, weighted_spectrum
from tinysplat_runtime.codec.quantise import choose_code_map
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import matrices_to_quats, normalize_quats, quats_to_matrices
from tinysplat_runtime.gaussian.sh import sh_basis
from tinysplat_runtime.graphs.inference import CONTRACTS, GraphStore
from tinysplat_runtime.render.prepare import ALPHA_MIN, prepare, principal_axes
from tinysplat_runtime.render.project import DILATION, Splats, View, project
from tinysplat_runtime.scene.cameras import Camera

VIEWS, HEIGHT, WIDTH = 2, 256, 256
DISTANCE = 1000.0
"""Of the scene from the world's origin: where plain float32 starts to show."""

Run = Callable[[], Any]
Error = Callable[[Any], float]


def make_gaussians(degree: int = 4) -> Gaussians:
    """Per-pixel Gaussians 2 to 4 units deep, in the frame of a float64 origin `DISTANCE` away."""
    rng = np.random.default_rng(0)
    origin = DISTANCE * np.array([1.0, -0.7, 0.4])
    K = np.array([[230.0, 0, 128], [0, 230, 128], [0, 0, 1]])
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    rays = np.stack([(x - 128) / 230, (y - 128) / 230, np.ones_like(x)], axis=-1)
    cameras, means = [], []
    for view in range(VIEWS):
        c2w, place = np.eye(4), np.array([0.2 * view, 0, 0])
        c2w[:3, :3] = quats_to_matrices(normalize_quats(np.array([1.0, 0.2, -0.3 + 0.1 * view, 0.1])))
        c2w[:3, 3] = origin + place
        cameras.append(Camera(K, c2w, WIDTH, HEIGHT))
        depth = 3 + np.sin(x / 20 + view) * np.cos(y / 15)
        means.append(rays * depth[..., None] @ c2w[:3, :3].T + place)
    lead = (VIEWS, HEIGHT, WIDTH)
    functions = (degree + 1) ** 2
    sh = rng.normal(size=(*lead, functions, 3)) / (1 + np.arange(functions))[:, None]
    scales = 0.01 * np.exp(rng.normal(size=(*lead, 3)))
    return Gaussians(np.stack(means), rng.normal(size=(*lead, 4)), scales, rng.random(lead), sh, tuple(cameras), origin)


def _stage(name: str, effort: Effort, ways: dict[str, tuple[Run, Error]]) -> list[Row]:
    """Rows of one transform; an error comes as the figure `error`."""

    def figures(error: Error) -> Callable[[Any], dict[str, float]]:
        return lambda result: {"error": error(result)}

    variants = [Variant(way, run, figures(error)) for way, (run, error) in ways.items()]
    return measure("numerics speed", name, variants, effort)


def speed_rows(store: GraphStore, effort: Effort) -> list[Row]:
    """All transforms."""
    g = make_gaussians()
    stages = (_vpt, _synthesis, _vabr, _quantiser, _sh, _ewa)
    return [row for stage in stages for row in stage(g, store, effort)]


def _vpt(g: Gaussians, store: GraphStore, effort: Effort) -> list[Row]:
    """Depth, relative."""
    rotations = np.stack([camera.rotation for camera in g.cameras])
    centres = np.stack([camera.centre for camera in g.cameras])
    wanted = np.stack([project_view(g, view)[0] for view in range(VIEWS)])

    def tensors(dtype: torch.dtype, origin: NDArray, split: bool) -> dict[str, torch.Tensor]:
        local = centres - origin
        high = local.astype(np.float32).astype(np.float64) if split else local
        arrays = {
            "means": g.means.astype(np.float64) + (g.origin - origin), "quats": g.quats, "scales": g.scales,
            "opacities": g.opacities, "K": np.stack([c.K for c in g.cameras]), "rotation": rotations,
            "rotation_quat": matrices_to_quats(rotations), "centre_high": high, "centre_low": local - high,
        }  # fmt: skip
        return {name: torch.from_numpy(np.ascontiguousarray(a)).to(dtype) for name, a in arrays.items()}

    def twin(inputs: dict[str, torch.Tensor]) -> Run:
        ordered = [inputs[name] for name in CONTRACTS["analysis_vpt"].inputs]
        return lambda: ViewProjection()(*ordered)[0]

    def error(geometry: Any) -> float:
        return float(np.abs(np.asarray(geometry, np.float64)[:, 0] / wanted - 1).max())

    ours = {n: t.numpy() for n, t in tensors(torch.float32, g.origin, split=True).items()}
    return _stage("VPT", effort, {
        "float32": (twin(tensors(torch.float32, np.zeros(3), split=False)), error),
        "ours": (lambda: store.transform("analysis_vpt").run(ours)["geometry"], error),
        "float64": (twin(tensors(torch.float64, np.zeros(3), split=False)), error),
    })  # fmt: skip


def _synthesis(g: Gaussians, store: GraphStore, effort: Effort) -> list[Row]:
    """Means, in units of the scene's depth, from 13 planes of codes and 6 of colour."""
    rng = np.random.default_rng(1)
    planes, k, d = 13, 6, 75
    codes = rng.integers(0, 4096, (VIEWS, planes + 1, HEIGHT, WIDTH)).astype(np.uint16)
    colors = rng.integers(0, 4096, (VIEWS, k + 1, HEIGHT, WIDTH)).astype(np.uint16)
    codes[:, -1] = colors[:, -1] = 1
    mix = rng.uniform(-1e-4, 1e-4, (VIEWS, 11, planes + 1))
    mix[:, 0, :] = 0
    mix[:, 0, 0], mix[:, 0, -1] = 5e-4, 2.0
    rotations = np.stack([camera.rotation.T for camera in g.cameras])

    def arrays(centre: NDArray) -> dict[str, NDArray]:
        return {
            "geometry_codes": codes, "geometry_mix": mix, "color_codes": colors,
            "color_mix": np.full((k + 1, d), 1e-3), "K": np.stack([c.K for c in g.cameras]),
            "rotation": rotations, "rotation_quat": matrices_to_quats(rotations), "centre": centre,
            "inverse_depth": np.array(0.0), "relative_rotation": np.array(0.0), "depth_limits": np.array([0.1, 10.0]),
        }  # fmt: skip

    def cast(inputs: dict[str, NDArray], dtype: type) -> dict[str, NDArray]:
        return {n: a if a.dtype == np.uint16 else a.astype(dtype) for n, a in inputs.items()}

    def twin(inputs: dict[str, NDArray], is_double: bool) -> Run:
        ordered = [torch.from_numpy(np.ascontiguousarray(inputs[n])) for n in CONTRACTS["synthesis"].inputs]
        module = _DoubleSynthesis() if is_double else Synthesis()
        return lambda: module(*ordered)[0]

    world = np.stack([camera.centre for camera in g.cameras])
    near = world - g.origin
    wanted = np.asarray(twin(cast(arrays(near), np.float64), True)())

    def error(shift: NDArray) -> Error:
        return lambda means: float(np.abs(np.asarray(means, np.float64) - shift - wanted).max() / 3)

    ours = cast(arrays(near), np.float32)
    return _stage("VPT⁻¹ and VABR⁻¹", effort, {
        "float32": (twin(cast(arrays(world), np.float32), False), error(g.origin)),
        "ours": (lambda: store.transform("synthesis").run(ours)["means"], error(np.zeros(3))),
        "float64": (twin(cast(arrays(world), np.float64), True), error(g.origin)),
    })  # fmt: skip


class _DoubleSynthesis(Synthesis):
    """The twin on float64 codes: it turns them to float32 first, so they come in as float64 already."""

    def forward(self, geometry_codes: torch.Tensor, *rest: torch.Tensor) -> Any:
        mix, colors, *others = rest
        return super().forward(_Wide(geometry_codes), mix, _Wide(colors), *others)  # type: ignore[arg-type]


class _Wide:
    """A tensor of codes whose conversion to floating point gives float64."""

    def __init__(self, codes: torch.Tensor) -> None:
        self._codes, self.shape = codes, codes.shape

    def to(self, _: torch.dtype) -> torch.Tensor:
        return self._codes.to(torch.float64)

    def permute(self, *axes: int) -> _Wide:
        return _Wide(self._codes.permute(*axes))


def _vabr(g: Gaussians, store: GraphStore, effort: Effort) -> list[Row]:
    """Weighted coefficients at k = d, relative: what the transform itself loses."""
    x = g.sh.reshape(-1, 75)
    delta = second_moment_weighting(view_directions(g.cameras), 4)
    weights = np.kron(delta, np.eye(3))
    size = float(np.abs(x @ weights.T).max())

    def ours() -> tuple[NDArray, NDArray]:
        moment = store.transform("analysis_moment").run({"sh": g.sh})["moment"].astype(np.float64)
        reduction = reduce_basis(weighted_spectrum(moment, delta), delta, 75)
        projection = reduction.projection.astype(np.float32)
        color = store.transform("analysis_project").run({"sh": g.sh, "projection": projection})["color"]
        return np.moveaxis(color, 1, -1).reshape(-1, 75), reduction.inverse.astype(np.float64)

    def straight(dtype: Any) -> Run:
        w, wide = weights.astype(dtype), x.astype(dtype)

        def run() -> tuple[NDArray, NDArray]:
            vectors = np.linalg.eigh(w @ (wide.T @ wide / dtype(len(wide))) @ w.T)[1][:, ::-1]
            inverse = np.linalg.solve(w, vectors)
            return wide @ (w.T @ vectors), inverse

        return run

    def error(result: tuple[NDArray, NDArray]) -> float:
        planes, inverse = (a.astype(np.float64) for a in result)
        return float(np.abs((planes @ inverse.T - x) @ weights.T).max() / size)

    return _stage("VABR", effort, {
        "float32": (straight(np.float32), error), "ours": (ours, error), "float64": (straight(np.float64), error),
    })  # fmt: skip


def _quantiser(g: Gaussians, _: GraphStore, effort: Effort) -> list[Row]:
    """Codes that differ from float64's, in codes."""
    values = np.linspace(2, 4, VIEWS * HEIGHT * WIDTH).astype(np.float32).reshape(VIEWS, HEIGHT, WIDTH)
    code_map = choose_code_map(2.0, 4.0, 3.0, 1e-3)

    def exactly(dtype: type) -> Run:
        return lambda: np.rint((values.astype(dtype) - dtype(code_map.offset)) / dtype(code_map.scale))

    wanted = (values.astype(np.float64) - code_map.offset) / code_map.scale

    def error(codes: Any) -> float:
        return float(max(np.abs(np.asarray(codes, np.float64) - wanted).max() - 0.5, 0.0))

    return _stage("quantiser", effort, {
        "float32": (exactly(np.float32), error),
        "ours": (lambda: code_map.quantise(values)[0], error),
        "float64": (exactly(np.float64), error),
    })  # fmt: skip


def _sh(g: Gaussians, _: GraphStore, effort: Effort) -> list[Row]:
    """Basis functions of degree 4, absolute."""
    world = g.means.reshape(-1, 3).astype(np.float64) + g.origin
    centre = g.cameras[0].centre

    def unit(rays: NDArray) -> NDArray:
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    shift = (g.origin - centre).astype(np.float64)
    wanted = sh_basis(unit(world - centre), 4)

    def error(basis: Any) -> float:
        return float(np.abs(basis - wanted).max())

    return _stage("SH", effort, {
        "float32": (lambda: sh_basis(unit(world.astype(np.float32) - centre.astype(np.float32)), 4), error),
        "ours": (lambda: sh_basis(unit(g.means.reshape(-1, 3) + shift).astype(np.float32), 4), error),
        "float64": (lambda: sh_basis(unit(world - centre), 4), error),
    })  # fmt: skip


def _ewa(g: Gaussians, _: GraphStore, effort: Effort) -> list[Row]:
    """Pixel of the mean, in pixels: what projection must not lose."""
    flat, camera = g.flat(), g.cameras[0]
    blocks = prepare(flat)
    splats = Splats(sum(block.size for block in blocks))
    view = View.of(camera, flat.origin, 0.01)

    def ours() -> NDArray:
        for block in blocks:
            project(block, view, (4, 4), splats)
        return splats.records[:-1, :2]

    shown = flat.opacities >= ALPHA_MIN
    means, quats, scales = (a[shown] for a in (flat.means, flat.quats, flat.scales))

    def straight(dtype: Any) -> Run:
        world = (means.astype(np.float64) + flat.origin).astype(dtype)
        K, R, c = camera.K.astype(dtype), camera.rotation.astype(dtype), camera.centre.astype(dtype)

        def run() -> NDArray:
            p = (world - c) @ R.T
            z = p[:, 2]
            uv = p[:, :2] / z[:, None] * K[[0, 1], [0, 1]] + K[:2, 2]
            axes = principal_axes(normalize_quats(quats.astype(dtype)), scales.astype(dtype))
            f, zero = K[0, 0] / z, np.zeros_like(z)
            jacobian = np.stack([np.stack([f, zero, -f * p[:, 0] / z]), np.stack([zero, f, -f * p[:, 1] / z])])
            m = np.einsum("ijn,jkn->ikn", jacobian, axes)
            a, b, d = (np.einsum("kn,kn->n", m[i], m[j]) for i, j in ((0, 0), (0, 1), (1, 1)))
            np.reciprocal((a + dtype(DILATION)) * (d + dtype(DILATION)) - b * b)
            return uv

        return run

    wanted = straight(np.float64)()

    def error(uv: Any) -> float:
        return float(np.abs(np.asarray(uv, np.float64) - wanted).max())

    return _stage("EWA projection", effort, {
        "float32": (straight(np.float32), error), "ours": (ours, error), "float64": (straight(np.float64), error),
    })  # fmt: skip
