"""What files are held against for a wanted quality: which views, and how their pictures differ."""

from __future__ import annotations

from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.recipe.encode import raw_bytes


def test_a_report_says_what_was_measured() -> None:
    from tinysplat_runtime.codec.encoder import EncodeStats
    from tinysplat_runtime.recipe.encode import Encoded
    from tinysplat_runtime.recipe.report import encode_report

    runtime, gaussians, stats = ts.Runtime(threads=1), make_smooth_gaussians(2, 16, 24, 1), EncodeStats()
    data = runtime.compress(gaussians, stats=stats)
    coded = Encoded(data, gaussians, raw_bytes(gaussians), stats)
    report = encode_report(coded, runtime, model=None)
    assert report["bytes"] == len(data) and report["seconds"] == stats.watch.seconds
    assert set(report["error_by_attribute"]) == {"means", "quats", "scales", "opacities", "sh"}
    assert all(error["rmse"] > 0 for error in report["error_by_attribute"].values())
    assert (
        report["peak_rss_bytes"] > 10e6
        and "refine" not in report
        and coded.seconds == sum(stats.watch.seconds.values())
    )
