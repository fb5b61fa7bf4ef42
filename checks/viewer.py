"""The viewer's page in a headless Chromium, beside our rasteriser.

    apt-get install -y chromium && pip install playwright
    python checks/viewer.py F.tsplat [screenshot.png]

Opens the page from disk, without a network, at every input view in the picture's own size; compares the canvas with
our rasteriser; moves the sliders; and fails on any console message, or where a view agrees with less than 30 dB (the
browser blends in 8 bits).
"""

from __future__ import annotations

import base64
import io
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

LEAST_DB = 30.0
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
CUT_AT = "0.9"
CUT = f"const s = document.getElementById('opacity'); s.value = {CUT_AT}; s.dispatchEvent(new Event('change'))"
READY = "body[data-ready=yes]"


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
        subprocess.run(["tinysplat", "view", file, "--html", str(html), "-q"], check=True)
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        for view, camera in enumerate(gaussians.cameras):
            page = browser.new_page(viewport={"width": camera.width, "height": camera.height})
            page.context.set_offline(True)
            page.on("console", lambda message: messages.append(message.text))
            page.on("pageerror", lambda error: messages.append(str(error)))
            page.goto(f"{html.as_uri()}#bare&camera={view}")
            page.wait_for_selector(READY, timeout=90_000)
            error = np.mean((canvas(page) - ts.render(gaussians, camera)) ** 2)
            agreement = -10 * np.log10(error)
            faults += agreement < LEAST_DB
            print(f"view {view}: {agreement:.1f} dB beside our rasteriser")
            page.close()
        page = browser.new_page(viewport={"width": 560, "height": 420})
        page.on("console", lambda message: messages.append(message.text))
        page.on("pageerror", lambda error: messages.append(str(error)))
        page.goto(html.as_uri())
        page.wait_for_selector(READY, timeout=90_000)
        if screenshot:
            page.screenshot(path=screenshot, timeout=90_000)
        before = canvas(page)
        page.evaluate(CUT)
        page.wait_for_function(f"document.body.dataset.cut === '{CUT_AT}'", timeout=90_000)
        changed = np.abs(canvas(page) - before).mean()
        faults += not changed > 1e-3
        print(f"opacity cut at {CUT_AT}: picture changes by {changed:.4f}")
        browser.close()
    for message in messages:
        print("console:", message)
    return 1 if faults or messages else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
