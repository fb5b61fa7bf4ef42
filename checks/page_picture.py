"""A page of `tinysplat view --html`, as a browser of 1280×800 shows it once all of its scene is drawn.

    PYTHONPATH=tests python checks/page_picture.py docs/pages/plush.html docs/viewer.jpg

Needs Chromium.
"""

import argparse
import base64
from pathlib import Path

from page.browser import Browser


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("page", type=Path)
    parser.add_argument("picture", type=Path)
    given = parser.parse_args()
    with Browser() as browser:
        tab = browser.open(given.page.resolve().as_uri(), 1280, 800)
        tab.ready()
        taken = tab.send("Page.captureScreenshot", format="jpeg", quality=85)
        given.picture.write_bytes(base64.b64decode(taken["data"]))


if __name__ == "__main__":
    main()
