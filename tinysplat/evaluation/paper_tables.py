"""The paper's tables with ours beside the printed figures: same rows, same columns.

Rows `printed` are quoted from the paper (`published`), rows `here` are measured by this run. Data sets are columns:
`re10k` and `acid` as the paper's, `scenes` for a user's own. A figure with † is the decoded render against the raw one,
where Gaussian files bring no photos.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.encoder import EncodeStats
from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.gaussian.gaussians import Gaussians

from .measure import Prepared, prepare
from .published import BITS, MAIN, TIMES, VIEWS, Quality
from .records import Record
from .runner import Coding, Job, Plan, Settings, evaluate, list_jobs
from .sources import Source
from .summary import decode_seconds, encode_seconds, mean_record
from .tables import ABSENT, format_table, number

SCENES = "scenes"
PAPER_DATA = {"re10k": "RE10K", "acid": "ACID", "dl3dv": "DL3DV"}
BIT_STEPS = tuple(BITS)
POSITION = ("depth", "offset")
CLASSES = ("position", "scale", "rotation", "color", "opacity")


@dataclass(frozen=True)
class Inputs:
    """What a table is made from.

    Attributes:
        sources: scenes by data set: `re10k`, `acid`, `dl3dv`, or SCENES.
        models: networks by data set; the key "" serves those without their own.
        profiles: of ours.
        kinds: kinds of two-view windows of scene folders.
        limit: windows per scene, or None.
        size: (height, width) of scene folders' photos.
        settings: how to measure, and where results are kept.
        quiet: show no progress.
        views: number of context views that figures and the table of bits are made for; None for whatever there is,
            the table of bits for 2.
    """

    sources: dict[str, list[Source]]
    models: dict[str, tuple[str, ...]]
    profiles: tuple[str, ...]
    kinds: tuple[str, ...]
    limit: int | None
    size: dict[str, tuple[int, int]]
    settings: Settings
    quiet: bool = True
    views: int | None = None

    def plan(self, data: str, codings: Sequence[Coding], views: Sequence[int] = ()) -> Plan:
        """The plan for one data set; windows of more than two views are of whatever kind there is."""
        kinds = self.kinds if data == SCENES and (not views or 2 in views) else ()
        models = self.models.get(data, self.models.get("", ()))
        return Plan(self.sources[data], models, codings, self.size[data], kinds, views, self.limit)

    @property
    def wanted_views(self) -> tuple[int, ...]:
        """Of a plan: the one number, or nothing for any."""
        return () if self.views is None else (self.views,)

    def records(self, data: str, codings: Sequence[Coding], views: Sequence[int] = ()) -> list[Record]:
        """Measured; what is left out is said on standard error."""
        outcome = evaluate(self.plan(data, codings, views), self.settings, quiet=self.quiet)
        for line in (*outcome.left_out, *outcome.notes):
            print(f"paper: {line}", file=sys.stderr)
        return outcome.records

    def jobs(self) -> Iterator[Job]:
        """Every window of every data set, with no coding yet."""
        for data in self.sources:
            jobs, left_out, notes = list_jobs(self.plan(data, (), self.wanted_views))
            for line in (*left_out, *notes):
                print(f"paper: {line}", file=sys.stderr)
            yield from jobs

    def prepared(self, runtime: Runtime) -> Iterator[tuple[Job, Prepared]]:
        """Windows brought to Gaussians and rendered; those at fault are said and passed over."""
        for job in self.jobs():
            try:
                yield job, prepare(job.source.load(job.window, job.model, job.size, runtime), runtime)
            except TinySplatError as error:
                print(f"paper: left out {job}: {error}", file=sys.stderr)


def network_name(model: str) -> str:
    """The paper's name of a network whose file is called like it; else the file's stem."""
    stem = Path(model).stem if model.endswith(".onnx") else model
    return next((name for name in MAIN if name.lower() in stem.lower()), stem)


def main_table(inputs: Inputs) -> str:
    """Two views at Q_g = 0: network and codec by data set."""
    measured = {
        data: _by_network(inputs.records(data, [Coding(p, 0) for p in inputs.profiles], (2,)))
        for data in inputs.sources
    }
    columns = list(dict.fromkeys(["re10k", "acid", *measured]))
    networks = list(dict.fromkeys([*MAIN, *(name for groups in measured.values() for name in groups)]))
    rows = []
    for network in networks:
        for codec, cells in MAIN.get(network, {}).items():
            rows.append([network, codec, "printed", *(_printed(cells.get(data)) for data in columns)])
        ours = {data: groups[network] for data, groups in measured.items() if network in groups}
        rows += _measured_rows(network, ours, columns, inputs.profiles)
    header = ["network", "codec", "by", *(PAPER_DATA.get(data, data) for data in columns)]
    return _titled("Two views, Q_g = 0: PSNR dB / SSIM / LPIPS / MB", header, rows)


def views_table(inputs: Inputs) -> str:
    """2, 4 and 6 views at Q_g = 0."""
    rows = []
    columns = list(dict.fromkeys(["dl3dv", *inputs.sources]))
    for views, printed in VIEWS.items():
        for codec, quality in printed.items():
            cells = (_printed(quality if data == "dl3dv" else None) for data in columns)
            rows.append([f"{views} DepthSplat", codec, "printed", *cells])
        codings = [Coding(profile, 0) for profile in inputs.profiles]
        measured = {data: _by_network(inputs.records(data, codings, (views,))) for data in inputs.sources}
        for network in dict.fromkeys(name for groups in measured.values() for name in groups):
            ours = {data: groups[network] for data, groups in measured.items() if network in groups}
            rows += _measured_rows(f"{views} {network}", ours, columns, inputs.profiles)
    header = ["views, network", "codec", "by", *(PAPER_DATA.get(data, data) for data in columns)]
    return _titled("Context views, Q_g = 0: PSNR dB / SSIM / LPIPS / MB", header, rows)


def bits_table(inputs: Inputs) -> str:
    """Bytes and the share of each class at several Q_g."""
    rows = []
    for qp, (kilobytes, shares) in BITS.items():
        rows.append([f"{qp}", "TinySplat", "printed", number(kilobytes, 2), *(number(shares[c], 1) for c in CLASSES)])
    for data in inputs.sources:
        codings = [Coding(p, qp) for p in inputs.profiles for qp in BIT_STEPS]
        records = inputs.records(data, codings, inputs.wanted_views or (2,))
        for model in dict.fromkeys(r.model for r in records):
            for coding in codings:
                chosen = [r for r in records if (r.model, r.profile, r.qp) == (model, coding.profile, coding.qp)]
                if chosen:
                    label = f"{coding.profile}, {network_name(model)}, {data}"
                    rows.append([f"{coding.qp:g}", label, "here", *_bit_cells(chosen)])
    return _titled("Share of each class in percent of the planes' bytes", ["Q_g", "codec", "by", "KB", *CLASSES], rows)


def time_table(inputs: Inputs, rounds: int) -> str:
    """Seconds by stage: medians of interleaved rounds per window, mean over windows."""
    runtime = Runtime(threads=inputs.settings.threads)
    found: dict[str, list[dict[str, float]]] = {profile: [] for profile in inputs.profiles}
    for job in inputs.jobs():
        case = job.source.load(job.window, job.model, job.size, runtime)
        for profile, seconds in time_codings(case.gaussians, inputs.profiles, rounds, runtime).items():
            found[profile].append({**seconds, **case.seconds})
    columns = ("encode", "vpt", "vabr", "hevc", "decode")
    rows = [
        [codec, "printed", *(number(times.get(column), 3) for column in columns), ABSENT]
        for codec, times in TIMES.items()
    ]
    for profile, windows in found.items():
        if not windows:
            raise InputError("no window to time", where="table-time")
        mean = {name: statistics.mean(w.get(name, 0.0) for w in windows) for name in windows[0]}
        cells = {**mean, "encode": encode_seconds(mean), "hevc": mean.get("x265"), "decode": decode_seconds(mean)}
        network = mean.get("network")
        rows.append([profile, "here", *(number(cells.get(column), 3) for column in columns), number(network, 3)])
    title = (
        f"Seconds. Printed: i7-13700K with an RTX 4090. Here: {inputs.settings.threads} CPU threads, median of {rounds}"
        f" rounds, mean of {len(next(iter(found.values())))} windows"
    )
    return _titled(title, ["codec", "by", "encode", "VPT", "VABR", "HEVC", "decode", "network"], rows)


def time_codings(
    gaussians: Gaussians, profiles: Iterable[str], rounds: int, runtime: Runtime
) -> dict[str, dict[str, float]]:
    """Median seconds per stage of coding and decoding at Q_g = 0; profiles take turns, and a first round warms up."""
    seconds: dict[str, list[dict[str, float]]] = {profile: [] for profile in profiles}
    for n in range(rounds + 1):
        for profile, measured in seconds.items():
            stats = EncodeStats()
            data = runtime.compress(gaussians, profile, 0, drop_invalid=True, stats=stats)
            runtime.decompress(data, watch=stats.watch)
            if n > 0:
                measured.append(stats.watch.seconds)
    return {
        profile: {stage: statistics.median(m[stage] for m in measured) for stage in measured[0]}
        for profile, measured in seconds.items()
    }


def _by_network(records: Iterable[Record]) -> dict[str, list[Record]]:
    """Records by network; Gaussian files are the output of a network that their name tells."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(network_name(record.model), []).append(record)
    return groups


def _measured_rows(
    label: str, ours: dict[str, list[Record]], columns: Sequence[str], profiles: Sequence[str]
) -> list[list[str]]:
    if not ours:
        return []
    rows = [[label, "raw", "here", *(_raw_cell(ours.get(data)) for data in columns)]]
    for profile in profiles:
        chosen = {data: [r for r in records if r.profile == profile] for data, records in ours.items()}
        rows.append([label, profile, "here", *(_coded_cell(chosen.get(data)) for data in columns)])
    return rows


def _printed(quality: Quality | None) -> str:
    if quality is None:
        return ABSENT
    digits = 3 if quality.megabytes < 15 else 0
    return _cell(number(quality.psnr, 2), quality.ssim, quality.lpips, number(quality.megabytes, digits))


def _raw_cell(records: list[Record] | None) -> str:
    if not records:
        return ABSENT
    mean = mean_record(records)
    return _cell(number(mean["psnr_raw"], 2), mean["ssim_raw"], mean["lpips_raw"], number(mean["raw_bytes"] / 1e6, 1))


def _coded_cell(records: list[Record] | None) -> str:
    if not records:
        return ABSENT
    mean = mean_record(records)
    megabytes = number(mean["bytes"] / 1e6, 3)
    if mean["psnr"] is None:
        against_raw = f"{mean['psnr_decoded_raw']:.2f}†"
        return _cell(against_raw, mean["ssim_decoded_raw"], mean["lpips_decoded_raw"], megabytes)
    return _cell(number(mean["psnr"], 2), mean["ssim"], mean["lpips"], megabytes)


def _cell(psnr: str, ssim: float | None, lpips: float | None, megabytes: str) -> str:
    return f"{psnr} / {number(ssim, 4)} / {number(lpips, 4)} / {megabytes}"


def _bit_cells(records: Sequence[Record]) -> list[str]:
    mean = mean_record(records)
    classes = mean["bytes_by_class"]
    total = sum(classes.values())
    shares = {"position": sum(classes[name] for name in POSITION), **classes}
    return [number(mean["bytes"] / 1000, 2), *(number(100 * shares[name] / total, 1) for name in CLASSES)]


def _titled(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return f"{title}\n\n{format_table(header, rows)}\n"
