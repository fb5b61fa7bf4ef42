"""The paper's tables and figures, one command each, ours beside the printed figures.

    python benchmarks/paper.py table-main SCENES… [--model sweep]
    python benchmarks/paper.py table-main --data re10k re10k/test evaluation_index_re10k.json \\
        --model re10k:mvsplat_re10k.onnx --model re10k:depthsplat_base.onnx
    python benchmarks/paper.py table-views --data dl3dv dl3dv/test dl3dv_start_0_…_ctx_2v_….json …
    python benchmarks/paper.py table-time | table-bits | fig-vpt | fig-rd | fig-ablation | fig-k SCENES…

SCENES are scene folders with `eval_index.json`, folders of such, or Gaussian files. Text goes to standard output and,
with the pictures, to a folder. Results are kept there window by window: a killed run goes on where it stopped.
docs/EVALUATION.md, "The paper's tables".
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from tinysplat.commands.eval import choose_lpips, numbers, words
from tinysplat.datasets import SPECS
from tinysplat.evaluation import Settings, Source, find_sources, paper_figures, paper_tables
from tinysplat.evaluation.paper_tables import SCENES, Inputs
from tinysplat.measure.lpips import BACKBONE_FILES
from tinysplat_runtime.api import DEFAULT_MODEL
from tinysplat_runtime.cli.arguments import size
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.system.files import write_atomically
from tinysplat_runtime.system.threads import available_cores

COMMANDS = ("table-main", "table-views", "table-time", "table-bits", "fig-vpt", "fig-rd", "fig-ablation", "fig-k")
RD_QPS = (-6.0, -3.0, 0.0, 3.0, 6.0, 9.0, 12.0)
ABLATION_QPS = (-6.0, 0.0, 6.0, 12.0)


def build_parser() -> argparse.ArgumentParser:
    """The script's options."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("what", choices=COMMANDS)
    parser.add_argument("scenes", nargs="*", metavar="SCENES", help="scene folders, folders of such, Gaussian files")
    parser.add_argument("--data", nargs=3, action="append", default=[], metavar=("NAME", "FOLDER", "INDEX"),
                        help=f"a data set in chunks and its evaluation index; NAME is {', '.join(SPECS)}")  # fmt: skip
    parser.add_argument("--model", action="append", default=[], metavar="[NAME:]MODEL",
                        help=f"network, or one data set's network; default {DEFAULT_MODEL}")  # fmt: skip
    parser.add_argument("--profile", type=words, default=("paper", "balanced"), metavar="P,P")
    parser.add_argument("--qp", type=numbers, default=None, metavar="Q,Q", help="of fig-rd and fig-ablation")
    parser.add_argument(
        "--views",
        type=numbers,
        default=None,
        metavar="N,N",
        help="of figures and table-bits: one after the other for so many views, such as 2,4,6",
    )
    parser.add_argument("--kind", type=words, default=("near",), metavar="K,K", help="two-view windows; default near")
    parser.add_argument("--limit", type=int, metavar="N", help="windows per scene; figures: default 1")
    parser.add_argument("--size", type=size, default=(256, 256), metavar="HxW", help="of SCENES; default 256x256")
    parser.add_argument("--near", type=float, metavar="Z", help="over the index's or the data set's")
    parser.add_argument("--far", type=float, metavar="Z")
    parser.add_argument("--rounds", type=int, default=3, metavar="N", help="of table-time; default 3")
    parser.add_argument("--lpips", choices=(*BACKBONE_FILES, "none"), default="vgg")
    parser.add_argument("--lpips-backbone", metavar="F.pth", help="torchvision's weights of the backbone")
    parser.add_argument("--lpips-linear", metavar="F.pth", help="default: the package lpips's")
    parser.add_argument("-o", "--output", default="paper_results", metavar="FOLDER", help="default paper_results")
    parser.add_argument("--jobs", type=int, default=1, metavar="N")
    parser.add_argument("--threads", type=int, default=None, metavar="N", help="default: all cores")
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress")
    return parser


def make_inputs(args: argparse.Namespace) -> tuple[Inputs, str]:
    """What the options name, and a line about LPIPS."""
    sources: dict[str, list[Source]] = {}
    wanted = [(SCENES, args.scenes, None)] if args.scenes else []
    wanted += [(name, [folder], index) for name, folder, index in args.data]
    for name, paths, index in wanted:
        if name not in (*SPECS, SCENES):
            raise InputError(f"'{name}', accepted are {', '.join(SPECS)}", where="--data")
        dataset = name if name in SPECS else "re10k"
        found, left_out = find_sources(paths, index=index, dataset=dataset, near=args.near, far=args.far)
        sources.setdefault(name, []).extend(found)
        for entry in left_out:
            print(f"paper: {entry}", file=sys.stderr)
    if not any(sources.values()):
        raise InputError("nothing to measure; give SCENES or --data NAME FOLDER INDEX", where="paper")
    models: dict[str, list[str]] = {}
    for text in args.model or [DEFAULT_MODEL]:
        name, _, model = text.rpartition(":") if text.split(":")[0] in (*SPECS, SCENES) else ("", "", text)
        models.setdefault(name, []).append(model)
    lpips, lpips_text = choose_lpips(args.lpips, args.lpips_backbone, args.lpips_linear)
    sizes = {name: SPECS[name].size if name in SPECS else args.size for name in sources}
    threads = args.threads or max(1, available_cores() // args.jobs)
    is_figure = args.what in ("fig-vpt", "fig-ablation", "fig-k", "table-time")
    limit = args.limit or (1 if is_figure else None)
    settings = Settings(Path(args.output), lpips, threads=threads, processes=args.jobs)
    frozen = {name: tuple(found) for name, found in models.items()}
    inputs = Inputs(sources, frozen, args.profile, args.kind, limit, sizes, settings, args.quiet)
    return inputs, lpips_text


def make(args: argparse.Namespace) -> str:
    """Run one command; returns its text."""
    inputs, lpips_text = make_inputs(args)
    folder = inputs.settings.folder
    if not args.views:
        return make_one(args, inputs, folder, lpips_text)
    sections = []
    for views in map(int, args.views):
        text = make_one(args, replace(inputs, views=views), folder / f"{views}-views", lpips_text)
        sections.append(f"{views} views. {text}")
    return "\n".join(sections)


def make_one(args: argparse.Namespace, inputs: Inputs, folder: Path, lpips_text: str) -> str:
    """One command's text; its pictures go to `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    match args.what:
        case "table-main":
            return f"{paper_tables.main_table(inputs)}\n{lpips_text}\n"
        case "table-views":
            return f"{paper_tables.views_table(inputs)}\n{lpips_text}\n"
        case "table-time":
            return paper_tables.time_table(inputs, max(args.rounds, 1))
        case "table-bits":
            return paper_tables.bits_table(inputs)
        case "fig-vpt":
            return paper_figures.vpt_figure(inputs, folder)
        case "fig-rd":
            return paper_figures.rd_figure(inputs, folder, args.qp or RD_QPS)
        case "fig-ablation":
            return paper_figures.ablation_figure(inputs, folder, args.qp or ABLATION_QPS)
        case _:
            return paper_figures.k_figure(inputs, folder)


def main() -> int:
    """Entry point; the exit status is the command line's."""
    args = build_parser().parse_args()
    try:
        text = make(args)
        write_atomically(Path(args.output) / f"{args.what}.md", text.encode())
    except (TinySplatError, OSError) as error:
        print(f"paper: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
