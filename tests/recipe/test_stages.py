"""Which way photos go through a network, and what a report says of the file that they became."""

from __future__ import annotations

from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.recipe.encode import raw_bytes


def test_a_report_says_what_was_measured() -> None:
    from tinysplat_runtime.codec.job import EncodeStats
    from tinysplat_runtime.recipe.encode import Encoded
    from tinysplat_runtime.recipe.report import encode_report
    from tinysplat_runtime.refine.stats import RefineStats

    runtime, gaussians, stats = ts.Runtime(threads=1), make_smooth_gaussians(2, 16, 24, 1), EncodeStats()
    data = runtime.compress(gaussians, stats=stats)
    coded = Encoded(data, gaussians, raw_bytes(gaussians), stats)
    report = encode_report(coded, runtime, model=None)
    assert report["bytes"] == len(data) and report["seconds"] == stats.watch.seconds
    assert all(error["rmse"] > 0 for error in report["error_by_attribute"].values())
    assert "refine" not in report and coded.seconds == sum(stats.watch.seconds.values())
    stats = EncodeStats()
    data = runtime.compress(gaussians.flat(), stats=stats, keep_all=True)
    coded = Encoded(data, gaussians.flat(), raw_bytes(gaussians), stats, RefineStats(steps=3))
    report = encode_report(coded, runtime, model=None)
    assert report["mode"] == "list" and report["error_by_attribute"] == {} and report["refine"]["steps"] == 3
