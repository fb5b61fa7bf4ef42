"""Single-line bugs put into the code, one at a time, and what the nearest tests say (`make mutants`).

    python checks/mutants.py [--sample 300] [--seed 1] [--rooms container,web] [--jobs 1] [--again]

Samples evenly over rooms and works in a copy of the checkout under build/mutants. Each answer is a line of
build/mutants/results.jsonl, so that a run that was stopped goes on; `--again` tries once more, against code and tests
as they stand, what went unnoticed. A failing test counts only if it passes without the bug; a run that takes too long
counts for nothing.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import py_compile
import re
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections import Counter
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Any

from mutations import Mutation, has_effect, mutated, mutations

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "build" / "mutants"
TREE, RESULTS = BUILD / "tree", BUILD / "results.jsonl"
RUNTIME = Path("runtime/tinysplat_runtime")
WITH_TORCH = ("networks", "measure")
TIMEOUT_S = 600.0
FEW = 4
ACROSS = {
    "cli": "e2e/test_cli e2e/test_convert e2e/test_doctor e2e/test_intake hostile/test_shown",
    "codec": "golden/test_golden conformance/test_conformance parity/test_transforms property/*",
    "container": "golden/test_golden conformance/test_conformance hostile/*attacks web/test_inspect",
    "formats": "e2e/test_convert hostile/test_fuzz",
    "gaussian": "parity/test_transforms property/*",
    "graphs": "golden/test_official parity/test_edge_stages e2e/test_intake",
    "measure": "e2e/test_bench e2e/test_eval",
    "networks": "golden/test_official parity/test_edge* parity/test_sweep",
    "page": "hostile/test_shown",
    "recipe": "e2e/test_cli e2e/test_intake e2e/test_convert",
    "render": "parity/test_differentiable_rasteriser property/test_metamorphic",
    "scene": "hostile/test_fuzz e2e/test_intake",
    "system": "hostile/test_manifests hostile/test_shown",
    "web": "conformance/test_conformance page/test_javascript hostile/test_shown hostile/test_fuzz",
}
"""By room, what tests of several rooms say of it: each runs behind the room's own."""

HEAVY = ("numpy", "scipy.ndimage", "scipy.optimize", "onnxruntime", "av", "numba", "torch", "PIL.Image", "pytest")


def nearest_tests(module: str) -> list[str]:
    """The tests of `room/module.py`: those of its name, the few elsewhere that import it, its room's, and `ACROSS`."""
    room, own = Path("tests", Path(module).parts[0]), Path(module).stem
    others = [path for path in sorted(Path("tests").glob("*/test_*.py")) if path.parent != room]
    named = sorted(room.glob(f"test_{own}.py")) + [path for path in others if path.name == f"test_{own}.py"]
    dotted = re.compile(re.escape(".".join(Path(module).with_suffix("").parts)) + r"\b")
    importing = [path for path in others if dotted.search(path.read_text(encoding="utf-8")) and path not in named]
    near = [*named, *(importing if len(importing) <= FEW else [])]
    across = ACROSS.get(room.name, "").split()
    beyond = [path for pattern in across for path in sorted(Path("tests").glob(f"{pattern}.py"))]
    return list(dict.fromkeys(map(str, [*near, *sorted(room.glob("test_*.py")), *beyond])))


def modules() -> list[Path]:
    """The modules that are tried, relative to the checkout: those of every room that has tests."""
    paths = [*(ROOT / RUNTIME).rglob("*.py"), *(ROOT / RUNTIME).rglob("*.js")]
    paths += [path for room in WITH_TORCH for path in (ROOT / "tinysplat" / room).rglob("*.py")]
    inside = [path.relative_to(ROOT) for path in sorted(paths) if path.stem != "__init__"]
    return [path for path in inside if len(_inside(path).parts) > 1 and (ROOT / "tests" / _room(path)).is_dir()]


def _inside(path: Path) -> Path:
    """`room/module.py` of a module."""
    return path.relative_to(RUNTIME if path.is_relative_to(RUNTIME) else "tinysplat")


def _room(path: Path) -> str:
    return _inside(path).parts[0]


def main(arguments: list[str] | None = None) -> int:
    """Run as many mutants as asked for and are not done, and write what is known."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sample", type=int, default=300, help="mutants in all")
    parser.add_argument("--seed", default="1", help="which sample")
    parser.add_argument("--rooms", default="", help="rooms to try alone, such as container,web")
    parser.add_argument("--jobs", type=int, default=1, help="workers; more than cores make tests run out of time")
    parser.add_argument("--again", action="store_true", help="try those once more that no test noticed")
    args = parser.parse_args(arguments)
    rooms, known = set(filter(None, args.rooms.split(","))), _known()
    chosen = _unnoticed(known) if args.again else _sample(args.sample, args.seed)
    wanted = [m for m in chosen if (args.again or m.place not in known) and (not rooms or _room(m.path) in rooms)]
    for name in HEAVY:
        importlib.import_module(name)
    workers = [_worker(wanted[n :: args.jobs], n) for n in range(args.jobs)]
    if sum(os.waitpid(worker, 0)[1] for worker in workers):
        return 1
    _doubt()
    (BUILD / "report.md").write_text(_report(), encoding="utf-8")
    return 0


def _worker(wanted: list[Mutation], number: int) -> int:
    """A process that tries these, in a copy of its own; its id."""
    child = os.fork()
    if child == 0:
        try:
            global TREE
            TREE = BUILD / f"tree{number}"
            copy_checkout()
            for mutation in wanted:
                _keep(try_mutation(mutation))
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
    return child


def copy_checkout() -> None:
    """What git tracks, as it stands, with compiled kernels: a run that is killed leaves a mutant in the copy alone."""
    shutil.rmtree(TREE, ignore_errors=True)
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    kernels = [str(path.relative_to(ROOT)) for path in (ROOT / RUNTIME).rglob("*.nb[ic]")]
    for name in [*filter(None, listed.split("\0")), *kernels]:
        if (ROOT / name).is_file():
            (TREE / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, TREE / name)
            if name.endswith(".py"):
                py_compile.compile(str(TREE / name))
    # processes that tests start look here first, wherever a .pth file of the environment points
    (TREE / "sitecustomize.py").write_text(f"import sys\nsys.path[:0] = {[str(TREE / 'runtime'), str(TREE)]!r}\n")


def _sample(count: int, seed: str) -> list[Mutation]:
    """The first by hash of every room, as many of each, and in turns, so that a run that is stopped is even."""
    by_room: dict[str, list[Mutation]] = {}
    for module in modules():
        by_room.setdefault(_room(module), []).extend(mutations(ROOT, module))
    for drawable in by_room.values():
        # a number one up and one down are two, drawn each for itself
        drawable.sort(key=lambda mutation: sha256(f"{seed} {mutation.place} {mutation.occurrence}".encode()).digest())
    rounds = -(-count // len(by_room))
    texts = {module: (ROOT / module).read_text(encoding="utf-8") for module in modules()}
    drawn = [
        list(islice((m for m in drawable if has_effect(texts[m.path], m)), rounds)) for drawable in by_room.values()
    ]
    return [drawable[n] for n in range(rounds) for drawable in drawn if n < len(drawable)][:count]


def _unnoticed(known: dict[str, list[dict[str, Any]]]) -> list[Mutation]:
    """The same changes of the same lines, wherever they stand now."""
    survivors = []
    for tries in known.values():
        last = tries[-1]
        if last["outcome"] != "noticed" and (ROOT / last["path"]).is_file():
            text = (ROOT / last["path"]).read_text(encoding="utf-8")
            same = (m for m in mutations(ROOT, Path(last["path"])) if m.what == last["what"])
            again = next((m for m in same if _lines(text, m) == (last["old"], last["new"])), None)
            survivors += [again] if again else []
    return survivors


def _lines(text: str, mutation: Mutation) -> tuple[str, str]:
    """The line before and after; of a bug that spans several, the first."""
    before, after = text.splitlines(), mutated(text, mutation).splitlines()
    differs = (n for n, (old, new) in enumerate(zip(before, after, strict=False)) if old != new)
    changed = next(differs, mutation.line - 1)
    return before[changed].strip(), after[changed].strip()


def try_mutation(mutation: Mutation) -> dict[str, Any]:
    """What the nearest tests say, as a row."""
    path, began = TREE / mutation.path, time.monotonic()
    text = path.read_text(encoding="utf-8")
    old, new = _lines(text, mutation)
    aside = _take_kernels(mutation.path)
    try:
        path.write_text(mutated(text, mutation), encoding="utf-8")
        os.chdir(TREE)
        status, output = run_tests(nearest_tests(str(_inside(mutation.path))))
    finally:
        path.write_text(text, encoding="utf-8")
        _take_kernels(mutation.path)
        for name, data in aside.items():
            name.write_bytes(data)
        _older(path)
    failed = re.findall(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", output, re.MULTILINE)
    outcome = {0: "unnoticed", None: "out of time"}.get(status, "noticed")
    return {
        "place": mutation.place,
        "room": _room(mutation.path),
        "path": str(mutation.path),
        "line": mutation.line,
        "what": mutation.what,
        "old": old,
        "new": new,
        "outcome": outcome,
        "by": failed[:1],
        "seconds": round(time.monotonic() - began, 1),
    }


def _older(path: Path) -> None:
    """Give the file back the time that its compiled form and its kernels know."""
    stamp = (ROOT / path.relative_to(TREE)).stat()
    os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))


def _take_kernels(path: Path) -> dict[Path, bytes]:
    """Remove compiled kernels that may hold something of the module, and return them."""
    stale, taken = {path.stem}, dict[Path, bytes]()
    texts = {file.stem: file.read_text(encoding="utf-8") for file in (TREE / RUNTIME).rglob("*.py")}
    kernels = {stem: text for stem, text in texts.items() if re.search("numba|kernels_project", text)}
    for _ in range(3):
        named = "|".join(stale)
        stale |= {stem for stem, text in kernels.items() if re.search(rf"import .*({named})|({named}) import", text)}
    for file in TREE.rglob("*.nb[ic]"):
        if file.name.partition(".")[0] in stale:
            taken[file] = file.read_bytes()
            file.unlink()
    return taken


def run_tests(tests: list[str], *options: str) -> tuple[int | None, str]:
    """Status (None: out of time) and output of pytest in a fork, which has the heavy packages already."""
    log = TREE.with_suffix(".txt")
    child = os.fork()
    if child == 0:
        os.setsid()
        os.chdir(TREE)
        os.dup2(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644), 1)
        os.dup2(1, 2)
        os.environ.update({"PYTHONPATH": f"{TREE / 'runtime'}:{TREE}", "TINYSPLAT_MODELS": str(TREE / "models")})
        sys.dont_write_bytecode, sys.path[:0] = True, [str(TREE / "runtime"), str(TREE)]
        command = f"-q -x --tb=line -p no:cacheprovider --timeout={TIMEOUT_S / 3:.0f}".split()
        status = 70
        try:
            status = int(importlib.import_module("pytest").main([*command, "-m", "not slow", *options, *tests]))
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            os._exit(status)
    ends = time.monotonic() + TIMEOUT_S
    while time.monotonic() < ends:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            _end_group(child)
            return os.waitstatus_to_exitcode(status), log.read_text(encoding="utf-8", errors="replace")
        time.sleep(0.05)
    _end_group(child)
    os.waitpid(child, 0)
    return None, ""


def _end_group(child: int) -> None:
    """Kill what a fork has started and left: a script that never ends, for one."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)


def _doubt() -> None:
    """Take back what was noticed by a test that fails without any bug, too."""
    rows = [json.loads(line) for line in RESULTS.read_text(encoding="utf-8").splitlines()]
    tests = sorted({test for row in rows for test in row["by"]})
    copy_checkout()
    _, output = run_tests(tests, "--maxfail=1000") if tests else (0, "")
    wrong = set(re.findall(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", output, re.MULTILINE))
    for row in rows:
        if wrong & set(row["by"]):
            row |= {"outcome": "unnoticed", "by": [], "wrong": row["by"]}
    RESULTS.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")


def _keep(row: dict[str, Any]) -> None:
    with RESULTS.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def _known() -> dict[str, list[dict[str, Any]]]:
    """All tries of every change, by the place where it was first put."""
    tries: dict[str, list[dict[str, Any]]] = {}
    places: dict[tuple[str, ...], str] = {}
    for line in RESULTS.read_text(encoding="utf-8").splitlines() if RESULTS.is_file() else ():
        row = json.loads(line)
        place = places.setdefault((row["path"], row["what"], row["old"], row["new"]), row["place"])
        tries.setdefault(place, []).append(row)
    return tries


def _report() -> str:
    """Markdown: what was noticed at once and by now, by room, and every survivor as a change."""
    known = _known()
    tried, first, now = Counter[str](), Counter[str](), Counter[str]()
    for tries in known.values():
        room = tries[0]["room"]
        tried[room] += 1
        first[room] += tries[0]["outcome"] == "noticed"
        now[room] += tries[-1]["outcome"] == "noticed"
    lines = ["# Mutants", "", "| room | tried | noticed at once | now |", "|---|--:|--:|--:|"]
    lines += [f"| {room} | {tried[room]} | {first[room]} | {now[room]} |" for room in sorted(tried)]
    lines += [f"| **all** | **{tried.total()}** | **{first.total()}** | **{now.total()}** |", "", "## Survivors", ""]
    for tries in known.values():
        row = tries[-1]
        if row["outcome"] != "noticed":
            change = ["```diff", f"- {row['old']}", f"+ {row['new']}", "```"]
            lines += [f"{row['place']} ({row['outcome']})", "", *change, ""]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
