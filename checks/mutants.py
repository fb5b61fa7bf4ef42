"""Single-line bugs put into the runtime's arithmetic, one at a time, and what the nearest tests say (`make mutants`).

    python checks/mutants.py [--sample 300] [--rooms container,codec] [--again] [-o report.md]

cosmic-ray makes the mutants and runs the tests, in a copy of the checkout under build/mutants. Its session file keeps
what was found, so that a run that was stopped goes on, and a larger sample adds to a smaller one; with `--again`, what
went unnoticed is tried once more, against the tests as they stand. The sample follows from the mutants alone: their
order is that of a hash. cosmic-ray and not mutmut, which rewrites whole modules into
trampolines, wants its own copy of the package on the path and has no test command of each module's own.
"""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

from cosmic_ray import plugins
from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec, TestOutcome, WorkItem, WorkResult

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "build" / "mutants"
TREE = BUILD / "tree"
RUNTIME = Path("runtime/tinysplat_runtime")
TIMEOUT_S = 240.0

SWAPS = ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "FloorDiv_Div", "Mod_Mul", "Pow_Mul", "LShift_RShift",
         "RShift_LShift", "BitAnd_BitOr", "BitXor_BitAnd")  # fmt: skip
"""Of cosmic-ray's 130 exchanges of a binary operator, one for each; `|` is left to annotations."""

COMPARISONS = ("Lt_LtE", "LtE_Lt", "Gt_GtE", "GtE_Gt", "Lt_Gt", "Gt_Lt", "LtE_Gt", "GtE_Lt", "Eq_NotEq", "NotEq_Eq")
OTHERS = ("AddNot", "NumberReplacer", "ReplaceAndWithOr", "ReplaceOrWithAnd", "ReplaceFalseWithTrue",
          "ReplaceTrueWithFalse", "ReplaceUnaryOperator_USub_UAdd", "ZeroIterationForLoop")  # fmt: skip


def nearest_tests(module: str) -> list[str]:
    """The tests of a module of the runtime, `room/module.py`: the file of its name first, then the rest of its room."""
    room, own = Path("tests", Path(module).parts[0]), Path(module).stem
    return [*(str(path) for path in sorted(room.glob(f"test_{own}.py"))), str(room)]


def modules() -> list[str]:
    """The modules that are tried: those of every room that has tests."""
    found = (path.relative_to(RUNTIME) for path in sorted((ROOT / RUNTIME).rglob("*.py")))
    return [str(path) for path in found if (ROOT / "tests" / path.parts[0]).is_dir() and path.stem != "__init__"]


def main(arguments: list[str] | None = None) -> int:
    """Run as many mutants as asked for and are not done, and write what is known."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sample", type=int, default=300, help="mutants in all, those of earlier runs included")
    parser.add_argument("--rooms", default="", help="folders or modules to try alone, such as container,codec/basis.py")
    parser.add_argument("--again", action="store_true", help="try those once more that no test noticed")
    parser.add_argument("-o", "--output", type=Path, default=BUILD / "report.md")
    args = parser.parse_args(arguments)
    rooms = tuple(filter(None, args.rooms.split(",")))
    _copy_checkout()
    os.chdir(TREE)
    with use_db(str(BUILD / "session.sqlite"), WorkDB.Mode.create) as session:
        chosen = _sample(rooms, args.sample)
        known = {item.job_id for item in session.work_items}
        session.add_work_items(item for item in chosen if item.job_id not in known)
        done = {job for job, found in session.results if not args.again or _is_noticed(found)}
        for item in chosen:
            if item.job_id not in done:
                result = mutate_and_test(item.mutations, _command(item.mutations[0]), TIMEOUT_S)
                session.set_result(item.job_id, result)
                print(result.test_outcome, item.job_id, flush=True)
        args.output = ROOT / args.output
        args.output.parent.mkdir(parents=True, exist_ok=True)
        args.output.write_text(_report(session, chosen), encoding="utf-8")
    return 0


def _copy_checkout() -> None:
    """What git tracks, as it stands: a run that is killed leaves a mutant in the copy alone."""
    shutil.rmtree(TREE, ignore_errors=True)
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file() and not name.startswith(("benchmarks/reports", "docs")):
            (TREE / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, TREE / name)


def _operators() -> list[str]:
    names = [f"ReplaceBinaryOperator_{swap}" for swap in SWAPS]
    names += [f"ReplaceComparisonOperator_{swap}" for swap in COMPARISONS]
    known = set(plugins.operator_names())
    return [name for name in (f"core/{name}" for name in (*names, *OTHERS)) if name in known]


def _sample(rooms: tuple[str, ...], count: int) -> list[WorkItem]:
    """The first `count` mutants by hash, of the rooms asked for."""
    chosen = [module for module in modules() if not rooms or module.startswith(rooms)]
    items = [item for module in chosen for item in _mutants(module)]
    return sorted(items, key=lambda item: sha256(item.job_id.encode()).digest())[:count]


def _mutants(module: str) -> Iterator[WorkItem]:
    """Every mutant of a module, named by what it is of: a module that has changed has others."""
    path = RUNTIME / module
    nodes, version = list(ast_nodes(get_ast_from_path(path))), sha256(path.read_bytes()).hexdigest()[:8]
    lines = path.read_text(encoding="utf-8").splitlines()
    for name in _operators():
        operator = plugins.get_operator(name)()
        places = [place for node in nodes for place in operator.mutation_positions(node)]
        for occurrence, (start, end) in enumerate(places):
            if lines[start[0] - 1].lstrip().startswith("@"):
                continue  # what decorators are told is no arithmetic
            mutation = MutationSpec(path, name, occurrence, start, end)
            yield WorkItem.single(f"{_place(mutation)} of {version}", mutation)


def _module(mutation: MutationSpec) -> str:
    return str(Path(mutation.module_path).relative_to(RUNTIME))


def _place(mutation: MutationSpec) -> str:
    line, column = mutation.start_pos
    return f"{_module(mutation)}:{line}:{column} {mutation.operator_name.split('/')[-1]} {mutation.occurrence}"


def _command(mutation: MutationSpec) -> str:
    tests = nearest_tests(_module(mutation))
    return shlex.join([sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests])


def _is_noticed(result: WorkResult) -> bool:
    """Whether a test failed. One that ran out of time, as on a busy machine, says nothing."""
    return bool(result.test_outcome == TestOutcome.KILLED and result.output != "timeout")


def _report(session: WorkDB, chosen: list[WorkItem]) -> str:
    """Markdown: the share that was noticed by module, and every survivor as a change."""
    results = dict(session.results)
    found = [(i.mutations[0], results[i.job_id]) for i in chosen if i.job_id in results]
    killed = Counter(_module(m) for m, r in found if _is_noticed(r))
    tried = Counter(_module(m) for m, _ in found)
    total = f"**{sum(killed.values())} of {len(found)}** noticed, of a sample of {len(chosen)}"
    lines = ["# Mutants", "", total, "", "| module | noticed | tried |", "|---|---|---|"]
    lines += [f"| {module} | {killed[module]} | {tried[module]} |" for module in sorted(tried)]
    lines += ["", "## Survivors", ""]
    for mutation, result in found:
        if not _is_noticed(result):
            outcome = "timeout" if result.output == "timeout" else result.test_outcome
            changed = [r for r in (result.diff or "").splitlines() if r[:1] in "+-" and r[:3] not in ("+++", "---")]
            lines += [f"{_place(mutation)} ({outcome})", "", "```diff", *changed, "```", ""]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
