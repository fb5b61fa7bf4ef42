"""What of a file is enough? How near target sizes and dB are met, and what a prefix shows.

Targets: `share` of the target size that the file has; `loss_db`, what the search's file lacks against a plain one at
the same bytes, moved along 0.085 octaves and 0.5 dB per Q_g; for dB, `excess_db`; and the ratio of CPU time to a plain
encode at the Q_g that was found. Prefixes: PSNR to the raw render, at the ends of sections and at sizes between.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.encoder import encode_gaussians
from tinysplat_runtime.codec.profiles import PROFILES, find_profile
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.errors import FormatError, InputError

from ..clock import timed
from ..pictures import Drawing, Pictures
from ..rows import Row
from ..show.plots import Axis, Chart
from ..show.tables import Listing, decibels, digits, kilobytes, mean, percent, said
from ..study import Run, Study
from ..subjects.cases import Case

SIZES, PSNRS = (40_000, 80_000, 160_000), (38.0,)
PREFIXES_BETWEEN = 16
_DB_PER_OCTAVE = 0.5 / 0.085


def target_rows(run: Run) -> Iterator[Row]:
    """Every target of every case and profile."""
    sizes = (40_000,) if run.quick else SIZES
    targets: list[dict[str, Any]] = [{"target_size": size} for size in sizes]
    targets += [{"target_psnr": db} for db in PSNRS]
    for case in run.cases:
        pictures = Pictures(_at_its_views(case), Drawing(run.threads, {"compiled": False}))
        for profile in run.options.profiles or (("balanced",) if run.quick else tuple(PROFILES)):
            for target in targets:
                yield _target_row(pictures, profile, target, run.runtime, rounds=1 if run.quick else 3)


def _at_its_views(case: Case) -> Case:
    """The case judged where the search judges, as it draws: at the views of its Gaussians, by default."""
    cameras = case.gaussians.cameras
    nothing = (None,) * len(cameras)
    return replace(case, cameras=cameras, photos=nothing, depths=nothing) if cameras else case


def _target_row(pictures: Pictures, profile: str, target: dict[str, Any], runtime: Runtime, rounds: int) -> Row:
    case, data = pictures.case, list[bytes]()

    def searched() -> None:
        data.append(runtime.compress(case.gaussians, profile, drop_invalid=True, **target))

    setting = {"profile": profile, **target}
    try:
        searched()
    except InputError as error:  # beyond what the profile reaches here
        return Row("targets", case.name, profile, setting, note=str(error))
    qp = inspect_bytes(data[0])["qp"]
    encode = partial(encode_gaussians, case.gaussians, find_profile(profile), qp, runtime.store,
                     threads=runtime.threads, drop_invalid=True)  # fmt: skip
    ratios = [timed(searched)[1] / timed(encode)[1] for _ in range(rounds)]
    hit, plain = data[0], encode()
    found, of_plain = (
        pictures.figures(runtime.decompress(coded))["psnr_decoded_raw"] for coded in (hit, plain)
    )  # fmt: skip
    figures = {"bytes": len(hit), "qp": qp, "psnr": found}
    if "target_size" in target:
        moved = _DB_PER_OCTAVE * math.log2(len(hit) / len(plain))
        figures |= {"share": len(hit) / target["target_size"], "loss_db": of_plain + moved - found}
    else:
        figures["excess_db"] = found - target["target_psnr"]
    costs = {"cpu_ratio": statistics.median(ratios)}
    return Row("targets", case.name, profile, setting, figures, costs)


def _met(rows: Sequence[Row]) -> str:
    """The range over subjects of what was met of a target."""
    if "share" in rows[0].figures:
        shares = [row.figures["share"] for row in rows]
        return f"{min(shares):.1%} to {max(shares):.1%} of it"
    excess = [row.figures["excess_db"] for row in rows]
    return f"+{min(excess):.2f} to +{max(excess):.2f} dB"


def _target(rows: Sequence[Row]) -> str:
    size, db = rows[0].setting.get("target_size"), rows[0].setting.get("target_psnr")
    return f"{size / 1000:g} KB" if size else f"{db:g} dB"


def _loss(rows: Sequence[Row]) -> str:
    losses = [row.figures["loss_db"] for row in rows if "loss_db" in row.figures]
    return decibels(max(losses)) if losses else ""


def prefix_rows(run: Run) -> Iterator[Row]:
    """PSNR against bytes received."""
    for case in run.cases:
        pictures, runtime = Pictures(case, run.drawing), run.runtime
        for profile in run.options.profiles or ("balanced",):
            data = runtime.compress(case.gaussians, profile, drop_invalid=True)
            ends = {prefix["bytes"] for prefix in inspect_bytes(data)["prefixes"]}
            count = 4 if run.quick else PREFIXES_BETWEEN
            for size in sorted({*ends, *np.linspace(1, len(data), count + 1)[1:].astype(int).tolist()}):
                try:
                    decoded = runtime.decompress(data, max_bytes=size)
                except FormatError:
                    continue  # nothing to show yet
                psnr = pictures.figures(decoded)["psnr_decoded_raw"]
                setting = {"profile": profile, "bytes": size, "is_end": size in ends}
                yield Row("prefixes", case.name, profile, setting, {"psnr_decoded_raw": psnr, "of": len(data)})


TARGETS = Study.of(
    "Targets",
    target_rows,
    Listing(
        "targets",
        {"profile": said("way"), "wanted": _target, "met": _met, "dB lost at the same bytes, at most": _loss,
         "× the CPU time of a plain encode": mean("cpu_ratio", digits(2), "costs")},
        by=("way", "target_size", "target_psnr"), wanted=lambda row: bool(row.figures),
    ),
)  # fmt: skip
PREFIXES = Study.of(
    "Prefixes",
    prefix_rows,
    Listing(
        "prefixes",
        {"": said("subject"), "profile": said("way"), "KB": said("bytes", kilobytes),
         "share": lambda rows: percent(rows[0].setting["bytes"] / rows[0].figures["of"]),
         "dB to raw": mean("psnr_decoded_raw", decibels)},
        wanted=lambda row: row.setting["is_end"],
    ),
    Chart("prefixes", "What a prefix shows", Axis("bytes", "bytes received (KB)", "setting", 1e-3),
          Axis("psnr_decoded_raw", "dB to raw"), curve="subject", point="bytes", log=""),
)  # fmt: skip
