"""Pictures of the pages: the command that makes each, and which of them are older than what they show.

    python checks/pictures.py                                # all, with their commands (`make pictures`)
    python checks/pictures.py docs/rates.png                 # makes one anew, and records what it shows
    python checks/pictures.py --record docs/rates.png        # records one that its command has made elsewhere

A picture is older where files that it shows have other contents than when it was recorded (docs/pictures.json).
"""

import argparse
import hashlib
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "docs" / "pictures.json"
EXAMPLES = "python examples/demo.py --out demo_out"
ENCODED = "python examples/demo.py --out demo_out --photos && tinysplat encode demo_out/motorcycle -o demo.tsplat"
PAGE = ["runtime/tinysplat_runtime/page/*.html", "runtime/tinysplat_runtime/page/*.css"]
MUG = "tinysplat encode mug/ --masks background -o mug.tsplat"
DRAWN_BY_ENGINES = "PYTHONPATH=tests python checks/engines.py demo.tsplat docs/engines.webp docs/dilated.webp"
RATES = "tinysplat bench rates SCENES"
BESIDE_OURS = "python checks/opensplat.py OPENSPLAT SCENES --study rates --steps 300,1000 --out bench_report/rows.jsonl"
ENGINES = f"{ENCODED} --size 256x256 && {DRAWN_BY_ENGINES}"


@dataclass(frozen=True)
class MadePicture:
    """How a picture is made.

    Attributes:
        command: for a shell in the root of a checkout, with the development environment on its path.
        shows: patterns of the files whose contents decide how it looks.
        needs: what else the command takes.
    """

    command: str
    shows: Sequence[str]
    needs: str = ""


PICTURES = {
    "docs/flight.webp": MadePicture(
        f"{MUG} && python examples/flight.py mug.tsplat docs/flight.webp",
        ["examples/flight.py", "models/edge.onnx"],
        "mug/: the photos and masks that docs/pages/README.md names",
    ),
    "docs/pages/mug.html": MadePicture(
        f"{MUG} && tinysplat view mug.tsplat --background white --html docs/pages/mug.html --force",
        [*PAGE, "models/edge.onnx"],
        "mug/: the photos and masks that docs/pages/README.md names",
    ),
    "docs/pages/conch.html": MadePicture(
        "tinysplat encode conch/ -o conch.tsplat && tinysplat view conch.tsplat --html docs/pages/conch.html --force",
        [*PAGE, "models/edge.onnx"],
        "conch/: the photos that docs/pages/README.md names",
    ),
    "docs/demo.png": MadePicture(
        f"{EXAMPLES} && cp demo_out/motorcycle_256x256_balanced_view0.png docs/demo.png",
        ["examples/demo.py", "models/edge.onnx"],
    ),
    "docs/pages/plush.html": MadePicture(
        "tinysplat encode plush/ -o whole.tsplat"
        " && tinysplat compress whole.tsplat -o plush.tsplat --target-size 880KB"
        " && tinysplat view plush.tsplat --html docs/pages/plush.html --force",
        [*PAGE, "models/edge.onnx"],
        "plush/: the photos that docs/pages/README.md names",
    ),
    "docs/pages/drone.html": MadePicture(
        "tinysplat encode drone/ -o drone.tsplat && tinysplat view drone.tsplat --html docs/pages/drone.html --force",
        [*PAGE, "models/edge.onnx"],
        "drone/: the photos that docs/pages/README.md names",
    ),
    "docs/viewer.jpg": MadePicture(
        "PYTHONPATH=tests python checks/page_picture.py docs/pages/plush.html docs/viewer.jpg",
        ["docs/pages/plush.html"],
        "Chromium",
    ),
    "docs/engines.webp": MadePicture(
        ENGINES, ["checks/engines.*", "runtime/tinysplat_runtime/web/adapters/*js"], "what checks/README.md says"
    ),
    "docs/dilated.webp": MadePicture(ENGINES, ["checks/engines.*"], "what checks/README.md says"),
    "docs/rates.png": MadePicture(
        f"{RATES} && cp bench_report/plots/rates.png docs/rates.png",
        ["benchmarks/reports/2026-11-30/rates.jsonl"],
        "SCENES: the captures of docs/MEASURING.md",
    ),
    "docs/seconds.png": MadePicture(
        f"{RATES} && {BESIDE_OURS} --version V && {RATES} && cp bench_report/plots/rates_seconds.png docs/seconds.png",
        ["benchmarks/reports/2026-11-30/seconds.jsonl"],
        "SCENES: the captures of docs/MEASURING.md; OPENSPLAT: your own build",
    ),
}


def digest(root: Path, patterns: Sequence[str]) -> str:
    """What files contain, in short."""
    files = sorted({path for pattern in patterns for path in root.glob(pattern)})
    parts = (path.relative_to(root).as_posix().encode() + path.read_bytes() for path in files)
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()[:16]


def older(root: Path = ROOT) -> list[str]:
    """Pictures that were made before what they show changed."""
    recorded = json.loads((root / RECORD.relative_to(ROOT)).read_text("utf-8"))
    return [name for name, picture in PICTURES.items() if recorded.get(name) != digest(root, picture.shows)]


def record(names: Sequence[str]) -> None:
    """Note what pictures show today."""
    recorded = json.loads(RECORD.read_text("utf-8")) if RECORD.exists() else {}
    recorded |= {name: digest(ROOT, PICTURES[name].shows) for name in names}
    kept = {name: recorded[name] for name in sorted(recorded) if name in PICTURES}
    RECORD.write_text(json.dumps(kept, indent=1) + "\n", "utf-8")


def main() -> int:
    """Print the table, or make pictures; returns the exit status, 1 where one is older."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pictures", nargs="*", choices=[[], *PICTURES], metavar="PICTURE")
    parser.add_argument("--record", action="store_true", help="they have been made")
    given = parser.parse_args()
    if not given.pictures:
        old = older()
        for name, picture in PICTURES.items():
            print(f"{name}: {'OLDER than what it shows' if name in old else 'as what it shows'}")
            print(f"    {picture.command}" + (f"    # {picture.needs}" if picture.needs else ""))
        return int(bool(old))
    for command in dict.fromkeys(PICTURES[name].command for name in given.pictures if not given.record):
        subprocess.run(command, shell=True, cwd=ROOT, check=True)
    record(given.pictures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
