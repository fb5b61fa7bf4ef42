"""Our .glb in three.js, Babylon.js and CesiumJS, beside our rasteriser, in a headless Chromium.

    apt-get install -y chromium && pip install playwright
    npm install three babylonjs babylonjs-loaders cesium    # in the folder that this is run in
    python checks/engines.py F.tsplat [pictures.png]

Every engine draws the same Gaussians from the same camera, moved and rolled against the first input view and three
times as large, with Gaussians widened as for other viewers (`--dilate`); turned so that it looks along no axis, and
with SH of degree 3 that tint, so that a wrong sign of any coefficient costs more than LEAST_DB allows. three.js and
Babylon.js read the extension KHR_gaussian_splatting, CesiumJS only SPZ within it, in a tile. Ours is drawn from the
very file that the engine reads. Fails where an engine agrees with it to less than LEAST_DB.
"""

from __future__ import annotations

import base64
import functools
import http.server
import io
import json
import math
import shutil
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page, sync_playwright
from viewer import FLAGS

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian import OWN_VARIANCE
from tinysplat_runtime.gaussian.editing import similarity
from tinysplat_runtime.gaussian.footprints import widened
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.scene.images import to_uint8

ENGINES = ("three", "babylon", "cesium")
LEAST_DB = 34.0
ZOOM = 3
PANEL = 256  # pixels of a picture's side in the composite
TURN, TINT = (0.7, -0.4, 0.5, 0.3), 0.1  # a rotation, and the spread of SH coefficients that all Gaussians share
ROLL_DEGREES, SHIFT = 10.0, (0.03, 0.02, 0.1)  # against the first view; scene units
FRAME = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenCV's axes to glTF's
Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # glTF's axes to a tile's
ON_GLOBE = np.array([[0.0, 0, 1, 6378137], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # east, north, up at 0° N 0° E


def scene(file: str) -> tuple[ts.Gaussians, ts.Camera]:
    """A file's Gaussians (N,), widened, turned and tinted, and its first camera, turned along."""
    turn = quats_to_matrices(normalize_quats(np.array(TURN)))
    gaussians = similarity(widened(ts.load_gaussians(file), OWN_VARIANCE), turn)
    flat = gaussians.flat()
    tint = np.random.default_rng(0).normal(scale=TINT, size=(16, 3)).astype(np.float32)
    sh = np.repeat(tint[None], flat.count, axis=0)
    sh[:, : flat.sh.shape[1]] += flat.sh[:, :16]
    tinted = ts.Gaussians(flat.means, flat.quats, flat.scales, flat.opacities, sh, origin=flat.origin)
    return tinted, gaussians.cameras[0]


def moved(camera: ts.Camera) -> ts.Camera:
    """A square camera of its own: shifted, rolled, with its principal point in the middle."""
    roll, size = math.radians(ROLL_DEGREES), ZOOM * min(camera.height, camera.width)
    step = np.eye(4)
    step[:2, :2] = [[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]]
    step[:3, 3] = SHIFT
    focal = ZOOM * float(camera.K[0, 0])
    K = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]])
    return ts.Camera(K, camera.c2w @ step, size, size)


def described(camera: ts.Camera) -> dict[str, Any]:
    """The camera as engines.html takes it."""
    matrix = FRAME @ camera.c2w
    place = ON_GLOBE @ Z_UP
    return {
        "eye": matrix[:3, 3].tolist(),
        "forward": matrix[:3, 2].tolist(),
        "up": (-matrix[:3, 1]).tolist(),
        "fov": 2 * math.atan(camera.height / (2 * float(camera.K[1, 1]))),
        "size": camera.width,
        "place": place.T.ravel().tolist(),
    }


def write_tileset(path: Path, gaussians: ts.Gaussians) -> None:
    """A tileset of one tile, `scene_spz.glb`, at a place on the globe."""
    means = (gaussians.means.astype(np.float64) + gaussians.origin) @ (Z_UP @ FRAME)[:3, :3].T
    middle = (means.min(axis=0) + means.max(axis=0)) / 2
    radius = float(np.linalg.norm(means - middle, axis=1).max())
    used = ["KHR_gaussian_splatting", "KHR_gaussian_splatting_compression_spz_2"]
    root = {
        "transform": ON_GLOBE.T.ravel().tolist(),
        "boundingVolume": {"sphere": [*middle.tolist(), radius]},
        "geometricError": 0,
        "refine": "ADD",
        "content": {"uri": "scene_spz.glb"},
    }
    content = {"extensionsUsed": used, "extensionsRequired": used}
    document = {
        "asset": {"version": "1.1"},
        "extensionsUsed": ["3DTILES_content_gltf"],
        "extensions": {"3DTILES_content_gltf": content},
        "geometricError": 100,
        "root": root,
    }
    path.write_text(json.dumps(document))


class Handler(http.server.SimpleHTTPRequestHandler):
    """The folder of scenes, and below /node_modules the packages of the folder that this is run in."""

    def translate_path(self, path: str) -> str:
        """Where the file of a request lies."""
        if path.startswith("/node_modules/"):
            return str(Path.cwd() / path.partition("?")[0].lstrip("/"))
        return super().translate_path(path)

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing is said of requests."""


def picture_of(page: Page, engine: str, view: dict[str, Any]) -> tuple[str, NDArray]:
    """An engine's name with its version, and its picture (H, W, 3) in [0, 1]."""
    shown = page.evaluate("([engine, view]) => window.show(engine, view)", [engine, view])
    data = base64.b64decode(shown["picture"].partition(",")[2])
    return shown["name"], np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), np.float64) / 255


def composite(pictures: list[NDArray]) -> Image.Image:
    """Pictures side by side, their middle halves, in 256 colours."""
    quarter = len(pictures[0]) // 4
    rows = [Image.fromarray(to_uint8(picture[quarter:-quarter, quarter:-quarter])) for picture in pictures]
    panels = [np.asarray(row.resize((PANEL, PANEL), Image.Resampling.LANCZOS)) for row in rows]
    picture = Image.fromarray(np.concatenate(panels, axis=1))
    return picture.quantize(palette=picture.quantize(256), dither=Image.Dither.FLOYDSTEINBERG)


def main(file: str, out: str | None = None) -> int:
    """Run the check; returns the exit status."""
    gaussians, first = scene(file)
    camera = moved(first)
    faults = 0
    messages: list[str] = []
    pictures: list[NDArray] = []
    with tempfile.TemporaryDirectory() as name, sync_playwright() as play:
        folder = Path(name)
        shutil.copy(Path(__file__).with_name("engines.html"), folder)
        ts.save_gaussians(folder / "scene.glb", gaussians)
        ts.save_gaussians(folder / "scene_spz.glb", gaussians, gltf_spz=True)
        write_tileset(folder / "tileset.json", gaussians)
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=name))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        for engine in ENGINES:
            read = ts.load_gaussians(folder / ("scene_spz.glb" if engine == "cesium" else "scene.glb"))
            ours = Renderer(read, 1, compiled=None, **DEFINITION).render(camera)
            page = browser.new_page(viewport={"width": camera.width, "height": camera.height})
            page.set_default_timeout(300_000)
            page.on("console", lambda message: messages.append(message.text))
            page.on("pageerror", lambda error: messages.append(str(error)))
            page.goto(f"http://127.0.0.1:{server.server_port}/engines.html")
            version, theirs = picture_of(page, engine, described(camera))
            page.close()
            agreement = -10 * math.log10(np.mean((theirs - ours) ** 2))
            faults += agreement < LEAST_DB
            print(f"{version}: {agreement:.2f} dB beside our rasteriser, {camera.width}x{camera.height}", flush=True)
            pictures += [theirs] if pictures else [ours, theirs]
        browser.close()
        server.shutdown()
    if out:
        composite(pictures).save(out, optimize=True)
    for message in messages:
        if "ReadPixels" not in message:  # of our own reading
            print("console:", message)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
