"""Rewrite what is pinned on purpose: golden files, the dump of one in docs/FORMAT.md, messages, contracts of graphs.

`make golden`; it prints what changed as a table (bytes, dB, where). A reviewed decision: its reason goes into the
changelog.
"""

import difflib
import re
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "runtime"), str(ROOT / "tests")]

from golden.cases import DATA, FILES, FileCase, golden_contracts, golden_messages, golden_planes  # noqa: E402

import tinysplat_runtime as ts  # noqa: E402
from tinysplat_runtime.codec.hevc import encode_plane  # noqa: E402
from tinysplat_runtime.codec.profiles import EncoderSettings  # noqa: E402
from tinysplat_runtime.gaussian.gaussians import FIELDS  # noqa: E402
from tinysplat_runtime.render.paths import ring  # noqa: E402

FORMAT = ROOT / "docs" / "FORMAT.md"
DUMPED = "example"


def main() -> None:
    """Write everything anew and print what changed."""
    DATA.mkdir(exist_ok=True)
    rows = [row for case in FILES if (row := rewritten_file(case))]
    for name, (codes, qp) in golden_planes().items():
        coded = encode_plane(codes, qp, EncoderSettings("medium"))
        rows += rewritten(DATA / f"{name}.hevc", coded.parameter_sets + coded.payload)
    rows += rewritten(FORMAT, dumped(FORMAT.read_text(encoding="utf-8")).encode())
    rows += rewritten(DATA / "messages.txt", golden_messages().encode())
    rows += rewritten(DATA / "contracts.txt", golden_contracts().encode())
    print("| file | bytes before | after | dB before | after | where |\n|---|--:|--:|--:|--:|---|")
    print("\n".join(rows) if rows else "| nothing changed | | | | | |")


def rewritten_file(case: FileCase) -> str:
    """Code a case, write the file and what it decodes to; returns its row, or nothing if no byte differs."""
    path, made = DATA / f"{case.name}.tsplat", case.make()
    before = path.read_bytes() if path.exists() else b""
    data = case.code(made, case.profile, case.qp)
    if data == before:
        return ""
    path.write_bytes(data)
    decoded = ts.decompress(data)
    arrays = {f"layer{n}_{name}": getattr(layer, name) for n, layer in enumerate(decoded.layers) for name in FIELDS}
    np.savez_compressed(DATA / f"{case.name}.npz", **arrays)
    quality = [f"{_psnr(ts.decompress(one), made):.2f}" if one else "" for one in (before, data)]
    return f"| {path.name} | {len(before)} | {len(data)} | {quality[0]} | {quality[1]} | {_where(before, data)} |"


def rewritten(path: Path, data: bytes) -> list[str]:
    """Write a file; returns its row, which names the lines of a text that differ, or none."""
    before = path.read_bytes() if path.exists() else b""
    if data == before:
        return []
    path.write_bytes(data)
    where = ""
    if before and path.suffix in (".txt", ".md"):
        lines = difflib.ndiff(before.decode().splitlines(), data.decode().splitlines())
        where = "<br>".join(line for line in lines if line[:1] in "+-")
    return [f"| {path.name} | {len(before)} | {len(data)} | | | {where} |"]


def dumped(text: str) -> str:
    """docs/FORMAT.md with the bytes of the golden file in its dump; what stands beside them is left to its author."""
    data = (DATA / f"{DUMPED}.tsplat").read_bytes()

    def line(match: re.Match[str]) -> str:
        at = int(match[1], 16)
        digits = data[at : at + len(bytes.fromhex(match[2]))].hex(" ")
        return f"{match[1]}  {digits} "

    return re.sub(r"^([0-9a-f]{6})  ((?:[0-9a-f]{2} )+)", line, text, flags=re.MULTILINE)


def _psnr(decoded: ts.Gaussians, made: ts.Gaussians) -> float:
    """Of pictures in the case's own views, or from about it."""
    cameras = made.cameras or ring(made, 3)
    errors = [np.mean((ts.render(decoded, camera) - ts.render(made, camera)) ** 2) for camera in cameras]
    return float(-10 * np.log10(np.mean(errors)))


def _where(before: bytes, data: bytes) -> str:
    """Classes of planes whose bytes differ, and by how much."""
    if not before:
        return "new"
    sizes = [ts.inspect(one)["bytes_by_class"] for one in (before, data)]
    names = [*dict.fromkeys([*sizes[0], *sizes[1]])]
    grown = {name: sizes[1].get(name, 0) - sizes[0].get(name, 0) for name in names}
    return ", ".join(f"{name} {by:+d}" for name, by in grown.items() if by) or "no class's size"


if __name__ == "__main__":
    main()
