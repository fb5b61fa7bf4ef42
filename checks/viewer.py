"""The viewer's page in a headless Chromium, beside our rasteriser.

    apt-get install -y chromium && pip install playwright
    python checks/viewer.py F.tsplat [screenshot.png]

Opens the page from disk, without a network, at every input view in the picture's own size and three times it;
compares the canvas with our rasteriser; moves a slider; and fails on any console message, or where a view agrees with
less than 45 dB. Prints frames a second of a turning camera, which say little about other machines: Chromium draws in
software here.
"""

from __future__ import annotations

import base64
import io
import itertools
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import sync_playwright

import tinysplat_runtime as ts

LEAST_DB = 45.0
ZOOM = 3
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
CUT_AT = "0.9"
CUT = f"const s = document.getElementById('opacity'); s.value = {CUT_AT}; s.dispatchEvent(new Event('input'))"
READY = "body[data-whole][data-ready='{}']"
TURN = """async () => {
  const pixel = new Uint8Array(4), { gl } = page.splats, start = performance.now();
  const sorted = async () => { while (!page.splats.isSorted) await new Promise((done) => setTimeout(done)); };
  let frames = 0;
  for (; performance.now() - start < 5000; frames++) {
    page.camera.swing(page.scene.up, 0.02 * Math.sin(frames / 5), 0, page.camera.target);
    page.move();
    await sorted();
    page.splats.draw(page.camera, page.drawing());
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); // waits for the picture
  }
  return frames / (performance.now() - start) * 1000;
}"""


def canvas(page: Any) -> NDArray:
    """(H, W, 3) in [0, 1] of what the page has drawn."""
    data = page.evaluate("document.getElementById('view').toDataURL()").partition(",")[2]
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"), np.float64) / 255


def main(file: str, screenshot: str | None = None) -> int:
    """Run the check; returns the exit status."""
    gaussians = ts.decompress(Path(file).read_bytes())
    messages: list[str] = []
    faults = 0
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        html = Path(folder) / "page.html"
        subprocess.run(
            [Path(sys.executable).with_name("tinysplat"), "view", file, "--html", str(html), "-q"], check=True
        )
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        for (view, own), times in itertools.product(enumerate(gaussians.cameras), (1, ZOOM)):
            camera = own.resized(times * own.height, times * own.width)
            page = browser.new_page(viewport={"width": camera.width, "height": camera.height})
            page.context.set_offline(True)
            page.on("console", lambda message: messages.append(message.text))
            page.on("pageerror", lambda error: messages.append(str(error)))
            page.goto(f"{html.as_uri()}#bare&camera={view}")
            page.wait_for_selector(READY.format(0), timeout=90_000)
            error = np.mean((canvas(page) - ts.render(gaussians, camera)) ** 2)
            agreement = -10 * np.log10(error)
            faults += agreement < LEAST_DB
            print(f"view {view}, {times} times its size: {agreement:.1f} dB beside our rasteriser")
            page.close()
        page = browser.new_page(viewport={"width": 560, "height": 420})
        page.on("console", lambda message: messages.append(message.text))
        page.on("pageerror", lambda error: messages.append(str(error)))
        page.goto(html.as_uri())
        page.wait_for_selector(READY.format(0), timeout=90_000)
        if screenshot:
            page.screenshot(path=screenshot, timeout=90_000)
        before = canvas(page)
        page.evaluate(CUT)
        page.wait_for_selector(READY.format(CUT_AT), timeout=90_000)
        changed = np.abs(canvas(page) - before).mean()
        faults += not changed > 1e-3
        print(f"opacity cut at {CUT_AT}: picture changes by {changed:.4f}")
        rate = page.evaluate(TURN)
        print(f"turning: {rate:.1f} frames/s of {gaussians.count} Gaussians at 560x420, each sorted anew, in software")
        browser.close()
    messages = [message for message in messages if "ReadPixels" not in message]  # of our own reading
    for message in messages:
        print("console:", message)
    return 1 if faults or messages else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
