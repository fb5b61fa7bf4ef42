"""Frames of a page that are torn: every frame of ten steps to the next place and of ten drags, in a headless Chromium.

    PYTHONPATH=tests python checks/page_frames.py fox.html [--size 1280x800] [--still] [--pause 2] [--save FOLDER]

They begin as soon as there is a picture, and follow each other whether or not all is decoded. A pixel within the
photo's frame is open where more than half of what lies behind shows through, and a frame is where more than LEAST of
them are: at a photo's place that is a tear, during a drag only where the frames before and after are not. With --still
steps are jumps, and a frame also counts where that many pixels are, by DIFFERENT, neither those of the picture before
nor those of the one after. Needs Chromium.
"""

from __future__ import annotations

import argparse
import base64
import io
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from page.browser import Browser, Tab
from PIL import Image

COUNT = 10
LEAST = 0.01
DIFFERENT = 0.12
WIDTH = 320  # of the pictures that are compared

# Notes of every frame drawn: the share of open pixels of the photo's frame, and a small picture of it.
RECORD = """(small) => {
  const { splats } = page, draw = splats.draw.bind(splats), noted = (globalThis.noted = []);
  const side = (whole, own) => [-1, 1].map((way) =>
    Math.round(Math.min(Math.max((whole + way * own) / 2, 0), whole)));
  const inside = (width, height) => {
    const { camera } = page, scale = Math.min(width / camera.width, height / camera.height) * camera.zoom * 0.94;
    return [side(width, scale * camera.width), side(height, scale * camera.height)];
  };
  splats.draw = (...given) => {
    draw(...given);
    const { gl, target } = splats, { width, height } = target, pixels = new Float32Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, pixels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const [[left, right], [bottom, top]] = inside(width, height);
    let open = 0;
    for (let y = bottom; y < top; y++) {
      for (let x = left; x < right; x++) open += pixels[4 * (y * width + x) + 3] > 0.5 ? 1 : 0;
    }
    const [[from, to], [low, high]] = inside(view.width, view.height), copy = document.createElement("canvas");
    [copy.width, copy.height] = [small, Math.round((small * (high - low)) / (to - from))];
    const place = [from, view.height - high, to - from, high - low, 0, 0, copy.width, copy.height];
    copy.getContext("2d").drawImage(view, ...place);
    noted.push({ open: open / ((right - left) * (top - bottom)), picture: copy.toDataURL() });
  };
}"""


def settled(tab: Tab) -> None:
    """Wait until everything has come to rest and is drawn."""
    rests = "!page.flight && !page.wanted && !(page.touched && page.mover.spring(0))"
    tab.wait(f"{rests} && 'whole' in document.body.dataset && 'ready' in document.body.dataset")


def taken(tab: Tab) -> list[tuple[float, NDArray]]:
    """The frames since the last call: share of open pixels, and picture (H, W, 3) in [0, 1]."""
    found: list[dict[str, Any]] = tab.evaluate("noted.splice(0)")
    return [(frame["open"], _picture(frame["picture"])) for frame in found]


def _picture(text: str) -> NDArray:
    data = base64.b64decode(text.partition(",")[2])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), np.float32) / 255


def torn(picture: NDArray, before: NDArray, after: NDArray) -> float:
    """The share of pixels that are neither those before nor those after."""
    if not picture.shape == before.shape == after.shape:
        return 0.0
    apart = [np.abs(picture - other).max(axis=2) > DIFFERENT for other in (before, after)]
    return float((apart[0] & apart[1]).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("page", help="a file or an address")
    parser.add_argument("--size", default="1280x800")
    parser.add_argument("--ratio", type=float, default=1)
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--pause", type=float, default=2, help="seconds from one movement to the next")
    parser.add_argument("--kinds", default="step,drag")
    parser.add_argument("--still", action="store_true", help="as a visitor who asks for reduced motion")
    parser.add_argument("--save", type=Path, help="where torn frames are kept")
    given = parser.parse_args()
    width, height = map(int, given.size.split("x"))
    address = given.page if "://" in given.page else Path(given.page).resolve().as_uri()
    with Browser() as browser:
        tab = browser.open(address, width, height, ratio=given.ratio, moves=not given.still)
        tab.wait("globalThis.page && performance.getEntriesByName('first picture').length")
        print(f"first picture {tab.evaluate('performance.getEntriesByName(`first picture`)[0].startTime') / 1e3:.1f} s")
        tab.evaluate("page.swing(false), 0")
        tab.evaluate(f"({RECORD})({WIDTH})")
        for kind in given.kinds.split(","):
            faults, worst, everything = 0, 0.0, list[tuple[float, NDArray]]()
            for n in range(given.count):
                tab.evaluate("page.isDirty = true, 0")
                if kind == "step":
                    tab.evaluate("(after.disabled ? document.getElementById('before') : after).click(), 0")
                else:
                    tab.drag(width / 2, height / 2, (-1) ** (n // 5) * 0.45 * width, 0.05 * height, steps=9)
                time.sleep(given.pause)
                found = taken(tab)
                for i, (share, picture) in enumerate(found):
                    fault = share
                    if given.still and kind == "step" and everything:
                        fault = max(fault, torn(picture, everything[-1][1], found[-1][1]))
                    faults, worst = faults + (fault > LEAST), max(worst, fault)
                    if given.save and fault > LEAST:
                        given.save.mkdir(parents=True, exist_ok=True)
                        Image.fromarray(np.uint8(255 * picture)).save(given.save / f"{kind}{n}_{i}_{fault:.3f}.png")
                everything += found
            shares = [share for share, _ in everything]
            alone = sum(b - max(a, c) > LEAST for a, b, c in zip(shares, shares[1:], shares[2:], strict=False))
            told = f"{kind}: {faults} of {len(everything)} frames open, at most {worst:.1%} of the photo"
            print(f"{told}; {alone} where those before and after are not", flush=True)
        settled(tab)
        last = taken(tab)
        print(
            f"at rest {last[-1][0] if last else share:.1%} open, after {tab.evaluate('performance.now()') / 1e3:.0f} s"
        )
        for message in browser.messages:
            if "ReadPixels" not in message:
                print("console:", message[:200])


if __name__ == "__main__":
    main()
