"""The page's arithmetic in node, of the text that its shaders run, beside our rasteriser."""

import json
import math
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from reference.rasteriser import Picture
from scenes import make_cameras, make_gaussians, make_smooth_gaussians
from web.node import node

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render.near import NearViews
from tinysplat_runtime.render.renderer import NEAR_PLANE

PAGE = Path(ts.__file__).parent / "page"
SCRIPT = Path(__file__).with_name("draw.mjs")


def as_view(camera: ts.Camera, origin: NDArray) -> dict[str, Any]:
    K = camera.K
    return {
        "width": camera.width,
        "height": camera.height,
        "K": [K[0, 0], K[0, 1], K[1, 1], K[0, 2], K[1, 2]],
        "rotation": camera.rotation.tolist(),
        "position": (camera.centre - origin).tolist(),
    }


def drawn(tmp_path: Path, gaussians: Gaussians, camera: ts.Camera, *, dilation: str, order: str) -> NDArray:
    """(H, W, 3) by the page's functions."""
    flat, near, parts, at = gaussians.flat(), NearViews.of(gaussians), [], 0
    for n, layer in enumerate(gaussians.layers):
        size = layer.count // max(len(gaussians.cameras), 1)
        for view in range(len(gaussians.cameras)) if gaussians.cameras else [-1]:
            parts.append({"view": view, "isFront": n == 0, "from": at, "to": at + size})
            at += size
    scene = {
        "width": camera.width,
        "height": camera.height,
        "parts": parts,
        "camera": as_view(camera, flat.origin),
        "views": [as_view(own, flat.origin) for own in gaussians.cameras or gaussians.viewpoints],
        "depth": near.depth if near else 1,
        "nearPlane": NEAR_PLANE,
        "degree": flat.degree,
        "dilation": dilation,
        "order": order,
        **{name: getattr(flat, name).reshape(-1).tolist() for name in ("means", "quats", "scales", "opacities", "sh")},
    }
    (tmp_path / "in.json").write_text(json.dumps(scene))
    command = [node(), str(SCRIPT), str(PAGE), str(tmp_path / "in.json"), str(tmp_path / "out.f32")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return blended(np.fromfile(tmp_path / "out.f32", np.float32).reshape(-1, 11), camera)


def blended(splats: NDArray, camera: ts.Camera) -> NDArray:
    """(H, W, 3) of splats in the order of drawing, by the reference: pixel of the middle, longer half axis (2), shorter
    one, opacity, part of alpha, whether in front, colour (3).
    """
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    back, front = pictures = Picture(x.shape), Picture(x.shape)
    for x0, y0, *along, across, opacity, part, is_front, red, green, blue in splats.astype(np.float64):
        long = math.hypot(*along)
        u, v = (x - x0) * along[0] + (y - y0) * along[1], (y - y0) * along[0] - (x - x0) * along[1]
        alpha = np.minimum(0.99, opacity * np.exp(-((u / long**2) ** 2) - (v / (long * across)) ** 2))
        alpha = np.where(alpha >= 1 / 255, part * alpha, 0)
        pictures[int(is_front)].blend(alpha, np.array([red, green, blue]), 0)
    return front.rgb + front.left[..., None] * back.rgb


def moved(camera: ts.Camera, by: tuple[float, float, float], turn: float) -> ts.Camera:
    c, s = np.cos(turn), np.sin(turn)
    c2w = np.array(camera.c2w)
    c2w[:3, :3] = (
        c2w[:3, :3] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    )
    c2w[:3, 3] += by
    return ts.Camera(camera.K, c2w, camera.width, camera.height)


def agrees(picture: NDArray, expected: NDArray) -> None:
    """But where rounding decides whether an alpha reaches 1/255."""
    difference = np.abs(picture - expected)
    assert difference.max() < 1.5 / 255 and difference.mean() < 5e-5


@pytest.mark.parametrize(("dilation", "order"), [("screen", "depth"), ("own", "near"), ("own", "depth")])
@pytest.mark.parametrize("times", [0.5, 1, 2])
@pytest.mark.parametrize("is_list", [False, True])
def test_pictures_are_the_rasteriser_s(tmp_path: Path, dilation: str, order: str, times: float, is_list: bool) -> None:
    planes = make_gaussians(3, 20, 28, degree=1)
    gaussians = replace(planes.flat(), viewpoints=planes.cameras) if is_list else planes
    camera = moved(planes.cameras[0], (0.1, -0.05, 0.2), 0.1).resized(int(20 * times), int(28 * times))
    expected = ts.render(gaussians, camera, dilation=dilation, order=order)
    picture = drawn(tmp_path, gaussians, camera, dilation=dilation, order=order)
    assert expected.std() > 0.05
    agrees(picture, expected)


@pytest.mark.parametrize("degree", range(5))
def test_colours_change_with_the_direction_as_the_rasteriser_s(tmp_path: Path, degree: int) -> None:
    gaussians = make_gaussians(1, 12, 16, degree=degree).flat()
    rng = np.random.default_rng(degree)
    gaussians = Gaussians(
        means=gaussians.means,
        quats=gaussians.quats,
        scales=gaussians.scales,
        opacities=gaussians.opacities,
        sh=rng.normal(0, 0.2, gaussians.sh.shape).astype(np.float32),
    )
    for by in ((0.0, 0, 0), (0.6, -0.4, 0.3)):
        camera = moved(make_cameras(1, 12, 16)[0], by, 0.2)
        picture = drawn(tmp_path, gaussians, camera, dilation="screen", order="depth")
        agrees(picture, ts.render(gaussians, camera))


@pytest.mark.parametrize("views", [2, 6, 9, 30])
def test_views_shares_are_the_rasteriser_s(tmp_path: Path, views: int) -> None:
    gaussians = make_smooth_gaussians(views, 8, 12)
    gaussians = replace(gaussians, opacities=0.4 * gaussians.opacities)  # so that what lies behind shows
    camera = moved(gaussians.cameras[views // 2], (0.03, 0.02, 0.01), 0.05)
    agrees(drawn(tmp_path, gaussians, camera, dilation="own", order="near"), ts.render(gaussians, camera))
