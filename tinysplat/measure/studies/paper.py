"""What does the paper print, and what do we measure? Its tables with ours beside: same rows, same columns.

Rows `printed` are quoted from the paper (arXiv 2506.09479) and never mixed with ours; rows `here` are measured by this
run. Data sets are columns: `re10k` and `acid` as the paper's, SCENES for a user's own. A figure with † is the decoded
render against the raw one, where Gaussian files bring no photos. Rate against quality over Q_g, which the paper plots,
is the study `curves`.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from tinysplat.datasets import SPECS
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.graphs import DEFAULT_MODEL

from ..quality import ProfileQp, Quality, decode_seconds, encode_seconds, mean_of_rows
from ..rows import Row, grouped
from ..runner import RunPlan, run_jobs
from ..show.tables import ABSENT, format_table, number
from ..study import Run, Study
from ..subjects.cases import Source
from ..subjects.sources import find_sources

STUDY = "paper"
SCENES = "scenes"
NAMES = {"re10k": "RE10K", "acid": "ACID", "dl3dv": "DL3DV"}
PROFILES = ("paper", "balanced")
CLASSES = ("position", "scale", "rotation", "color", "opacity")


# ---- printed ------------------------------------------------------------------------------------------------------

# Cells: PSNR in dB, SSIM, LPIPS (VGG), and size in MB (raw sizes are rounded there, and count 2^20 bytes).

MAIN: dict[str, dict[str, dict[str, str]]] = {
    "MVSplat": {
        "raw": {"re10k": "26.36 / 0.8679 / 0.1291 / 43", "acid": "28.21 / 0.8419 / 0.1448 / 43"},
        "FCGS": {"re10k": "25.90 / 0.8586 / 0.1533 / 2.650", "acid": "27.61 / 0.8298 / 0.1800 / 2.596"},
        "TinySplat": {"re10k": "26.32 / 0.8671 / 0.1349 / 0.216", "acid": "28.13 / 0.8401 / 0.1528 / 0.229"},
    },
    "DepthSplat": {
        "raw": {"re10k": "27.50 / 0.8900 / 0.1125 / 19", "acid": "28.37 / 0.8481 / 0.1417 / 19"},
        "FCGS": {"re10k": "27.35 / 0.8863 / 0.1201 / 2.674", "acid": "28.27 / 0.8454 / 0.1466 / 2.666"},
        "TinySplat": {"re10k": "27.43 / 0.8886 / 0.1192 / 0.166", "acid": "28.29 / 0.8470 / 0.1501 / 0.181"},
    },
}
"""Two views, Q_g = 0: network, codec, data set."""

VIEWS: dict[int, dict[str, str]] = {
    2: {
        "raw": "19.62 / 0.6265 / 0.2986 / 33",
        "FCGS": "19.26 / 0.6183 / 0.3061 / 4.518",
        "TinySplat": "19.52 / 0.6196 / 0.3147 / 0.615",
    },
    4: {
        "raw": "23.16 / 0.7792 / 0.1745 / 66",
        "FCGS": "22.23 / 0.7619 / 0.1897 / 9.054",
        "TinySplat": "22.99 / 0.7694 / 0.1923 / 1.275",
    },
    6: {
        "raw": "24.16 / 0.8191 / 0.1456 / 100",
        "FCGS": "22.74 / 0.7943 / 0.1672 / 13.561",
        "TinySplat": "23.95 / 0.8085 / 0.1633 / 1.892",
    },
}
"""DL3DV, DepthSplat: number of context views, codec."""

TIMES: dict[str, dict[str, float]] = {
    "FCGS": {"encode": 4.074, "decode": 4.095},
    "TinySplat": {"encode": 1.016, "vpt": 0.003, "vabr": 0.004, "hevc": 0.971, "decode": 0.042},
}
"""Seconds on an i7-13700K with an RTX 4090."""

BITS: dict[int, tuple[float, dict[str, float]]] = {
    0: (164.63, {"position": 21.4, "scale": 17.5, "rotation": 13.0, "color": 34.6, "opacity": 13.5}),
    3: (122.29, {"position": 21.0, "scale": 18.0, "rotation": 11.5, "color": 35.7, "opacity": 13.7}),
    6: (89.91, {"position": 20.5, "scale": 18.8, "rotation": 10.2, "color": 36.7, "opacity": 13.8}),
    12: (47.90, {"position": 20.0, "scale": 20.1, "rotation": 8.4, "color": 39.0, "opacity": 12.6}),
}
"""DepthSplat on 200 scenes of RE10K: Q_g to KB and the share of each class in percent."""

# ---- measured -----------------------------------------------------------------------------------------------------


def paper_rows(run: Run) -> Iterator[Row]:
    """Two views at every Q_g of the table of bits, four and six at Q_g 0."""
    profiles = run.options.profiles or PROFILES
    for data, sources in _data(run).items():
        models = _models(run, data)
        size = SPECS[data].size if data in SPECS else run.size
        for views in run.options.views or tuple(VIEWS):
            kinds = (run.options.kinds or ("near",)) if data == SCENES and views == 2 else ()
            plan = RunPlan(sources, models, size, kinds, (views,), run.options.limit or (1 if run.quick else None))
            qps = (0.0,) if views > 2 or run.quick else tuple(map(float, BITS))
            work = Quality(tuple(ProfileQp(p, qp) for p in profiles for qp in qps), run.lpips, study=STUDY)
            yield from run.done(run_jobs(plan, work, run.store, threads=run.threads, processes=run.options.jobs))


def _data(run: Run) -> dict[str, list[Source]]:
    """Scenes by data set."""
    by_name: dict[str, list[Source]] = {SCENES: list(run.sources)} if run.sources else {}
    for name, folder, index in run.options.data:
        if name not in SPECS:
            raise InputError(f"'{name}', accepted are {', '.join(SPECS)}", where="--data")
        options = {"near": run.options.near, "far": run.options.far}
        sources, lost = find_sources([folder], index=index, dataset=name, **options)
        by_name.setdefault(name, []).extend(sources)
        run.left_out += map(str, lost)
    if not any(by_name.values()):
        raise InputError("nothing to measure; give INPUT or --data NAME FOLDER INDEX", where="paper")
    return by_name


def _models(run: Run, data: str) -> tuple[str, ...]:
    """Networks of a data set: those named `DATA:MODEL`, else those without a data set's name."""
    named: dict[str, list[str]] = {}
    for name in run.options.models:
        prefix, _, model = name.rpartition(":") if name.split(":")[0] in (*SPECS, SCENES) else ("", "", name)
        named.setdefault(prefix, []).append(model)
    return tuple(named.get(data) or named.get("") or [DEFAULT_MODEL])


# ---- tables -------------------------------------------------------------------------------------------------------


def network_name(model: str) -> str:
    """The paper's name of a network whose file is called like it; else the file's stem."""
    stem = Path(model).stem if model.endswith(".onnx") else model
    return next((name for name in MAIN if name.lower() in stem.lower()), stem)


def _measured(rows: Sequence[Row], views: int | None = None) -> dict[str, dict[str, list[Row]]]:
    """Rows by network and data set, of windows of so many views."""
    by_network: dict[str, dict[str, list[Row]]] = {}
    for row in (row for row in rows if row.study == STUDY and views in (None, row.setting["views"])):
        data = row.setting["kind"] if row.setting["kind"] in SPECS else SCENES
        by_network.setdefault(network_name(row.setting["model"]), {}).setdefault(data, []).append(row)
    return by_network


def _at(rows: Iterable[Row], profile: str, qp: float = 0.0) -> list[Row]:
    return [row for row in rows if (row.setting["profile"], row.setting["qp"]) == (profile, qp)]


def main_table(rows: Sequence[Row]) -> str:
    """Two views at Q_g = 0: network and codec by data set."""
    measured = _measured(rows, 2)
    if not measured:
        return ""
    columns = list(dict.fromkeys(["re10k", "acid", *(data for groups in measured.values() for data in groups)]))
    lines = []
    for network in dict.fromkeys([*MAIN, *measured]):
        for codec, cells in MAIN.get(network, {}).items():
            lines.append([network, codec, "printed", *(cells.get(data, ABSENT) for data in columns)])
        lines += _lines(network, measured.get(network, {}), columns)
    header = ["network", "codec", "by", *(NAMES.get(data, data) for data in columns)]
    return f"Two views, Q_g = 0: PSNR dB / SSIM / LPIPS / MB\n\n{format_table(header, lines)}"


def views_table(rows: Sequence[Row]) -> str:
    """2, 4 and 6 views at Q_g = 0."""
    by_views = {views: _measured(rows, views) for views in VIEWS}
    if not any(by_views.values()):
        return ""
    groups = [data for measured in by_views.values() for by_data in measured.values() for data in by_data]
    columns, lines = list(dict.fromkeys(["dl3dv", *groups])), []
    for views, printed in VIEWS.items():
        for codec, cell in printed.items():
            cells = (cell if data == "dl3dv" else ABSENT for data in columns)
            lines.append([f"{views} DepthSplat", codec, "printed", *cells])
        for network, by_data in by_views[views].items():
            lines += _lines(f"{views} {network}", by_data, columns)
    header = ["views, network", "codec", "by", *(NAMES.get(data, data) for data in columns)]
    return f"Context views, Q_g = 0: PSNR dB / SSIM / LPIPS / MB\n\n{format_table(header, lines)}"


def bits_table(rows: Sequence[Row]) -> str:
    """Bytes and the share of each class at several Q_g, two views."""
    measured = _measured(rows, 2)
    lines = [
        [f"{qp}", "TinySplat", "printed", number(kilobytes, 2), *(number(shares[c], 1) for c in CLASSES)]
        for qp, (kilobytes, shares) in BITS.items()
    ]
    for network, groups in measured.items():
        for data, members in groups.items():
            for (profile, qp), chosen in grouped(members, "profile", "qp").items():
                mean = mean_of_rows(chosen)
                classes = mean["bytes_by_class"]
                shares = {"position": classes["depth"] + classes["offset"], **classes}
                cells = [number(100 * shares[name] / sum(classes.values()), 1) for name in CLASSES]
                label = f"{profile}, {network}, {data}"
                lines.append([f"{qp:g}", label, "here", number(mean["bytes"] / 1000, 2), *cells])
    header = ["Q_g", "codec", "by", "KB", *CLASSES]
    title = "Share of each class in percent of the planes' bytes"
    return f"{title}\n\n{format_table(header, lines)}" if measured else ""


def time_table(rows: Sequence[Row]) -> str:
    """Seconds by stage at Q_g = 0 and two views, medians over windows."""
    lines = [
        [codec, "printed", *(number(times.get(column), 3) for column in TIMES["TinySplat"]), ABSENT]
        for codec, times in TIMES.items()
    ]
    ours = [row for row in rows if row.study == STUDY and (row.setting["views"], row.setting["qp"]) == (2, 0)]
    for (profile,), members in grouped(ours, "profile").items():
        costs = {stage: statistics.median(row.costs.get(stage, 0.0) for row in members) for stage in members[0].costs}
        cells = {**costs, "encode": encode_seconds(costs), "hevc": costs.get("x265"), "decode": decode_seconds(costs)}
        network = number(costs.get("network"), 3)
        lines.append([profile, "here", *(number(cells.get(column), 3) for column in TIMES["TinySplat"]), network])
    title = "Seconds, medians over windows. Printed: i7-13700K with an RTX 4090; here: CPU threads of this run"
    header = ["codec", "by", "encode", "VPT", "VABR", "HEVC", "decode", "network"]
    return f"{title}\n\n{format_table(header, lines)}" if ours else ""


def _lines(label: str, ours: dict[str, list[Row]], columns: Sequence[str]) -> list[list[str]]:
    """A network's lines: raw, and each profile."""
    if not ours:
        return []
    lines = [[label, "raw", "here", *(_cell(ours.get(data, ()), "raw") for data in columns)]]
    for profile in dict.fromkeys(row.setting["profile"] for rows in ours.values() for row in rows):
        lines.append([label, profile, "here", *(_cell(_at(ours.get(data, ()), profile)) for data in columns)])
    return lines


def _cell(rows: Sequence[Row], codec: str = "") -> str:
    """PSNR, SSIM, LPIPS and MB of pictures of decoded Gaussians, or `raw` ones, against photos; † against raw ones."""
    if not rows:
        return ABSENT
    mean = mean_of_rows(rows)
    suffix, mark, size = "", "", number(mean["bytes"] / 1e6, 3)
    if codec:
        suffix, size = "_raw", number(mean["raw_bytes"] / 1e6, 1)
    elif mean["psnr"] is None:
        suffix, mark = "_decoded_raw", "†"
    psnr, ssim, lpips = (mean[f"{metric}{suffix}"] for metric in ("psnr", "ssim", "lpips"))
    return f"{number(psnr, 2)}{mark} / {number(ssim, 4)} / {number(lpips, 4)} / {size}"


PAPER = Study(
    "The paper's tables",
    paper_rows,
    {"paper main": main_table, "paper views": views_table, "paper bits": bits_table, "paper time": time_table},
)
