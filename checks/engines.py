"""`.tsplat` in three.js, Spark and Babylon.js by our adapters, beside our rasteriser, in a headless Chromium; and in
PlayCanvas' splat-transform.

    apt-get install -y chromium
    npm install three @sparkjsdev/spark @babylonjs/core @playcanvas/splat-transform    # in the folder this is run in
    PYTHONPATH=tests python checks/engines.py F.tsplat [engines.webp [dilated.webp]]

Every engine draws the same file from the same camera, moved and rolled against the first input view and three times as
large. The file is F's Gaussians, widened as for other viewers (`--dilate`); turned so that it looks along no axis, and
with SH of degree 3 that tint, so that a wrong sign of any coefficient costs more than LEAST_DB allows; kept exactly.
Fails where an engine agrees with our picture to less than LEAST_DB, or splat-transform's .ply is not what we decode.

The first picture shows what all draw, the second F in Spark from CLOSER times as near: as it is, and dilated.
"""

from __future__ import annotations

import base64
import io
import math
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from page.browser import Browser, Folder, served
from PIL import Image

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian import OWN_VARIANCE
from tinysplat_runtime.gaussian.editing import similarity
from tinysplat_runtime.gaussian.footprints import widened
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.scene.pictures import to_uint8

ENGINES = ("three", "spark", "babylon")
LEAST_DB = 36.0
ZOOM, CLOSER = 3, 4
PANEL = 256  # pixels of a picture's side in the composite
QUALITY = 90  # of composites that are WebP
TURN, TINT = (0.7, -0.4, 0.5, 0.3), 0.1  # a rotation, and the spread of SH coefficients that all Gaussians share
ROLL_DEGREES, SHIFT = 10.0, (0.03, 0.02, 0.1)  # against the first view; scene units
FRAME = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenCV's axes to those with y up
WEB = Path(ts.__file__).parent / "web"
TOLERANCE = 1e-5


def scene(file: str) -> tuple[bytes, ts.Camera]:
    """The file that engines read, and its first camera."""
    turn = quats_to_matrices(normalize_quats(np.array(TURN)))
    turned = similarity(widened(ts.load_gaussians(file), OWN_VARIANCE), turn)
    tint = np.random.default_rng(0).normal(scale=TINT, size=(16, 3)).astype(np.float32)

    def tinted(layer: ts.Gaussians) -> ts.Gaussians:
        sh = np.repeat(tint[None], layer.opacities.size, axis=0).reshape(*layer.opacities.shape, 16, 3)
        sh[..., : layer.sh.shape[-2], :] += layer.sh[..., :16, :]
        return replace(layer, sh=sh)

    layers = [tinted(layer) for layer in turned.extra_layers]
    whole = replace(tinted(turned), extra_layers=tuple(layers))
    return ts.compress(whole, lossless=True), turned.cameras[0]


def square(camera: ts.Camera, zoom: int, step: NDArray) -> ts.Camera:
    """A square camera of zoom times as many pixels, a step (4, 4) away, with its principal point in the middle."""
    size, focal = zoom * min(camera.height, camera.width), zoom * float(camera.K[0, 0])
    K = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]])
    return ts.Camera(K, camera.c2w @ step, size, size)


def moved(camera: ts.Camera) -> ts.Camera:
    """A camera of its own: shifted, rolled."""
    roll = math.radians(ROLL_DEGREES)
    step = np.eye(4)
    step[:2, :2] = [[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]]
    step[:3, 3] = SHIFT
    return square(camera, ZOOM, step)


def described(camera: ts.Camera) -> dict[str, Any]:
    """The camera as engines.html takes it."""
    matrix = FRAME @ camera.c2w
    return {
        "eye": matrix[:3, 3].tolist(),
        "forward": matrix[:3, 2].tolist(),
        "up": (-matrix[:3, 1]).tolist(),
        "fov": 2 * math.atan(camera.height / (2 * float(camera.K[1, 1]))),
        "size": camera.width,
    }


class Handler(Folder):
    """The scene's folder; below /web our decoder; below /node_modules the packages of the folder this is run in."""

    def translate_path(self, path: str) -> str:
        """Where the file of a request lies."""
        bare = path.partition("?")[0]
        if bare.startswith("/node_modules/"):
            return str(Path.cwd() / bare.lstrip("/"))
        if bare.startswith("/web/"):
            return str(WEB / bare.removeprefix("/web/"))
        return super().translate_path(path)


def picture_of(browser: Browser, address: str, engine: str, camera: ts.Camera) -> tuple[str, NDArray]:
    """An engine's name with its version, and its picture (H, W, 3) in [0, 1]."""
    tab = browser.open(f"{address}/engines.html?engine={engine}", camera.width, camera.height)
    tab.wait("window.isReady")
    shown = tab.evaluate(f"window.show({engine!r}, {described(camera)!r})")
    tab.close()
    data = base64.b64decode(shown["picture"].partition(",")[2])
    return shown["name"], np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), np.float64) / 255


def check_splat_transform(data: bytes, folder: Path) -> bool:
    """Whether the .ply that splat-transform makes of scene.tsplat is what we decode."""
    program = Path.cwd() / "node_modules" / ".bin" / "splat-transform"
    adapter, out = WEB / "adapters" / "splat-transform.mjs", folder / "scene.ply"
    subprocess.run([program, "-q", adapter, "-p", f"file={folder / 'scene.tsplat'}", out], check=True)
    theirs, ours = ts.load_gaussians(out), ts.decompress(data).flat()
    quats = np.abs(np.sum(normalize_quats(theirs.quats) * normalize_quats(ours.quats), axis=1))
    found = {
        name: float(np.abs(getattr(theirs, name) - getattr(ours, name)).max()) for name in ("means", "scales", "sh")
    }
    found["opacities"] = float(np.abs(theirs.opacities - ours.opacities).max())
    found["quats"] = float((1 - quats).max())
    print("splat-transform's .ply differs by", {name: f"{value:.1g}" for name, value in found.items()})
    return max(found.values()) < TOLERANCE


def middles(pictures: list[NDArray]) -> list[Image.Image]:
    """The middle halves of pictures."""
    quarter = len(pictures[0]) // 4
    return [Image.fromarray(to_uint8(picture[quarter:-quarter, quarter:-quarter])) for picture in pictures]


def save_beside(path: str, pictures: list[Image.Image]) -> None:
    """Write pictures side by side."""
    Image.fromarray(np.concatenate([np.asarray(picture) for picture in pictures], axis=1)).save(path, quality=QUALITY)


def closer(browser: Browser, address: str, file: str, folder: Path) -> list[Image.Image]:
    """The file in Spark, CLOSER times as large: as it is, and as `decode --dilate` writes it."""
    given, pictures = ts.load_gaussians(file), []
    camera = square(given.cameras[0], CLOSER, np.eye(4))
    for gaussians in (given, widened(given, OWN_VARIANCE)):
        (folder / "scene.tsplat").write_bytes(ts.compress(gaussians, lossless=True))
        pictures.append(picture_of(browser, address, "spark", camera)[1])
    return middles(pictures)


def main(file: str, out: str | None = None, closer_out: str | None = None) -> int:
    """Run the check; returns the exit status."""
    data, first = scene(file)
    camera = moved(first)
    ours = Renderer(ts.decompress(data), 1, compiled=None, **DEFINITION).render(camera)
    faults, pictures = 0, [ours]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scene.tsplat").write_bytes(data)
        faults += not check_splat_transform(data, folder)
        (folder / "engines.html").write_text(Path(__file__).with_name("engines.html").read_text())
        with Browser() as browser, served(folder, Handler) as address:
            for engine in ENGINES:
                version, theirs = picture_of(browser, address, engine, camera)
                agreement = -10 * math.log10(np.mean((theirs - ours) ** 2))
                faults += agreement < LEAST_DB
                print(
                    f"{version}: {agreement:.2f} dB beside our rasteriser, {camera.width}x{camera.height}", flush=True
                )
                pictures.append(theirs)
            if closer_out:
                save_beside(closer_out, closer(browser, address, file, folder))
            for message in browser.messages:
                print("console:", message[:300])
    if out:
        save_beside(out, [picture.resize((PANEL, PANEL), Image.Resampling.LANCZOS) for picture in middles(pictures)])
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
