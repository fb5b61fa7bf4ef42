"""The pages of examples/web as they stand, in a headless Chromium, and the adapters' types under `tsc --strict`.

    apt-get install -y chromium
    npm install three @types/three @sparkjsdev/spark @babylonjs/core typescript@5.9.3 RUNTIME/web
    PYTHONPATH=…/tests python …/checks/web_pages.py F.tsplat   # in that folder; RUNTIME: where tinysplat_runtime lies

Fails where a page says something to the console that is an error, or shows one colour.
"""

import base64
import io
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from page.browser import Browser, served
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
LEAST_SPREAD = 0.02  # standard deviation of a picture's colours
SECONDS = 60
SIZE = 320, 240


def spread(browser: Browser, address: str) -> float:
    """How much colours of a page differ, once they do."""
    tab = browser.open(address, *SIZE)
    tab.wait("document.readyState === 'complete'")
    end = time.monotonic() + SECONDS
    while True:
        data = base64.b64decode(tab.send("Page.captureScreenshot", format="png")["data"])
        found = float(np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), np.float64).std(axis=(0, 1)).max() / 255)
        if found > LEAST_SPREAD or time.monotonic() > end:
            tab.close()
            return found
        time.sleep(0.5)


def main(file: str) -> int:
    """Run the check; returns the exit status."""
    here, faults = Path.cwd(), 0
    shutil.copy(file, here / "scene.tsplat")
    for name in ("page.ts", "tsconfig.json"):
        shutil.copy(ROOT / "checks" / "types" / name, here)
    done = subprocess.run(["npx", "tsc", "-p", "tsconfig.json"], capture_output=True, text=True, check=False)
    print("types:", done.stdout.strip() or "as used")
    faults += done.returncode != 0
    for page in sorted((ROOT / "examples" / "web").glob("*.html")):
        name, text = page.name, page.read_text("utf-8")
        (here / name).write_text(text.replace("<!doctype html>", '<!doctype html><link rel="icon" href="data:,">'))
        with Browser() as browser, served(here) as address:
            found = spread(browser, f"{address}/{name}")
            errors = [message[:200] for message in browser.messages if "rror" in message or "Failed" in message]
        print(f"{name}: colours spread by {found:.3f}", *errors, flush=True)
        faults += found <= LEAST_SPREAD or bool(errors)
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
