"""Frames of a page with holes: every frame of ten steps to the next place and of ten drags, in a headless Chromium.

    PYTHONPATH=tests python checks/page_frames.py fox.html [--size 1280x800] [--ratio 1] [--save FOLDER]

A pixel within the photo's frame is open where more than half of what lies behind shows through. A frame has holes where
LEAST of these pixels are open beyond those that are so in both settled pictures, before the movement and after it.
Needs Chromium.
"""

from __future__ import annotations

import argparse
import base64
import time
from pathlib import Path
from typing import Any

from page.browser import Browser, Tab

COUNT = 10
LEAST = 0.005

# Notes of every frame drawn: the share of open pixels of the photo's frame, and a small picture where asked for.
RECORD = """(saves) => {
  const { splats } = page, draw = splats.draw.bind(splats), noted = (globalThis.noted = []);
  const inside = (width, height) => {
    const { camera } = page;
    const scale = Math.min(width / camera.width, height / camera.height) * camera.zoom * 0.94;
    const side = (whole, own) => [-1, 1].map((way) =>
      Math.round(Math.min(Math.max((whole + way * scale * own) / 2, 0), whole)));
    return [side(width, camera.width), side(height, camera.height)];
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
    noted.push({
      open: open / ((right - left) * (top - bottom)), width, at: performance.now(),
      picture: saves ? view.toDataURL("image/jpeg", 0.7) : "",
    });
  };
}"""


def settled(tab: Tab) -> None:
    """Wait until everything has come to rest and is drawn."""
    rests = "!page.flight && !page.wanted && !(page.touched && page.mover.spring(0))"
    tab.wait(f"{rests} && 'whole' in document.body.dataset && 'ready' in document.body.dataset")


def taken(tab: Tab) -> list[dict[str, Any]]:
    """The frames since the last call."""
    return list(tab.evaluate("noted.splice(0)"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("page", help="a file or an address")
    parser.add_argument("--size", default="1280x800")
    parser.add_argument("--ratio", type=float, default=1)
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--still", action="store_true", help="as a visitor who asks for reduced motion")
    parser.add_argument("--save", type=Path, help="where frames with holes are kept")
    given = parser.parse_args()
    width, height = map(int, given.size.split("x"))
    address = given.page if "://" in given.page else Path(given.page).resolve().as_uri()
    with Browser() as browser:
        tab = browser.open(address, width, height, ratio=given.ratio, moves=not given.still)
        tab.wait("globalThis.page && performance.getEntriesByName('first picture').length")
        print(f"first picture {tab.evaluate('performance.getEntriesByName(`first picture`)[0].startTime') / 1e3:.1f} s")
        tab.evaluate("page.swing(false), 0")
        settled(tab)
        print(f"whole after {tab.evaluate('performance.now()') / 1e3:.1f} s", flush=True)
        tab.evaluate(f"({RECORD})({'true' if given.save else 'false'})")
        tab.evaluate("page.isDirty = true, 0")
        settled(tab)
        before = taken(tab)[-1]["open"]
        for kind in ("step", "drag"):
            frames = holes = 0
            worst, began = 0.0, time.monotonic()
            for n in range(given.count):
                if kind == "step":
                    tab.evaluate("(after.disabled ? document.getElementById('before') : after).click(), 0")
                else:
                    tab.drag(width / 2, height / 2, (-1) ** (n // 5) * 0.45 * width, 0.05 * height, steps=9)
                time.sleep(0.3)
                settled(tab)
                found = taken(tab)
                after = found[-1]["open"] if found else before
                beyond = [frame["open"] - max(before, after) for frame in found]
                frames, holes = frames + len(found), holes + sum(one > LEAST for one in beyond)
                worst = max([worst, *beyond])
                if given.save:
                    given.save.mkdir(parents=True, exist_ok=True)
                    for i, (frame, one) in enumerate(zip(found, beyond, strict=True)):
                        if one > LEAST:
                            data = base64.b64decode(frame["picture"].partition(",")[2])
                            (given.save / f"{kind}{n}_{i}.jpg").write_bytes(data)
                before = after
            each = (time.monotonic() - began) / given.count
            told = f"{kind}: {holes} of {frames} frames with holes, at most {worst:.1%} of the photo"
            print(f"{told}, {each:.1f} s each", flush=True)
        for message in browser.messages:
            if "ReadPixels" not in message:
                print("console:", message[:200])


if __name__ == "__main__":
    main()
