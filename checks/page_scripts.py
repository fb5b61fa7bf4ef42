"""Smaller scripts for pages: those of today with shorter names, by terser (`make page`; needs npm).

    python checks/page_scripts.py          # writes runtime/tinysplat_runtime/page/small.json.gz
    python checks/page_scripts.py --check  # fails where that was made of other scripts

Pages take them for as long as they were made of the scripts that there are, and the scripts as written else.
"""

import gzip
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import tinysplat_runtime.page.build as build

TERSER = "terser@5.51.4"
FILE = Path(build.__file__).with_name(build.SMALL)


def smaller(text: str) -> str:
    """A module with shorter names and no spaces, and the same exports."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "module.js").write_text(text, "utf-8")
        command = ["npx", "--yes", "--package", TERSER, "terser", "module.js", "--module", "--compress", "--mangle"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def main() -> int:
    """Write them, or check what is there; returns the exit status."""
    texts = build.scripts_as_written()
    if "--check" in sys.argv:
        is_fresh = FILE.is_file() and build.scripts() != texts
        print(f"{FILE.name}: {'of these scripts' if is_fresh else 'of others; `make page` makes them anew'}")
        return int(not is_fresh)
    decoder, page, story = map(smaller, texts)
    made = {"of": build.scripts_digest(texts), "decoder": decoder, "page": page, "story": story}
    FILE.write_bytes(gzip.compress(json.dumps(made).encode(), 9, mtime=0))
    print(f"{FILE}: a page without a scene takes {len(build.player_page()) / 1e3:.0f} KB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
