"""Scenes of which half is not needed: what goes, what stays, and what that costs."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from list.looks import psnr
from scenes import make_gaussians, make_list, tells

import tinysplat_runtime as ts
from tinysplat_runtime.cli import main
from tinysplat_runtime.codec.job import EncodeStats
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.list.pruning.amount import Amount
from tinysplat_runtime.render.paths import ring
from tinysplat_runtime.system.threads import Crew

pytest.importorskip("numba")

from tinysplat_runtime.list.pruning.reduction import leave_out
from tinysplat_runtime.list.pruning.removal import Remover
from tinysplat_runtime.list.views import views_about


def joined(*parts: Gaussians) -> Gaussians:
    return Gaussians(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in FIELDS})


@pytest.fixture(scope="module")
def ball() -> Gaussians:
    """A shell of large opaque Gaussians, as many small ones inside that nobody sees, and cameras of small photos."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(450, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    some = make_list(450, 0, rng)
    shell = replace(
        some, means=directions, scales=np.full((450, 3), 0.16), opacities=np.full(450, 0.95), sh=0.2 * some.sh
    )
    inside = replace(shell, means=0.6 * directions, scales=np.full((450, 3), 0.02))
    return photographed(joined(shell, inside))


def photographed(gaussians: Gaussians) -> Gaussians:
    return replace(gaussians, viewpoints=tuple(small(views_about(gaussians, 12))))


def small(cameras: list[ts.Camera]) -> list[ts.Camera]:
    return [camera.resized(96, 96) for camera in cameras]


def around(gaussians: Gaussians) -> list[ts.Camera]:
    return small(ring(gaussians, 3))


def remover(gaussians: Gaussians, views: int) -> Remover:
    return Remover(gaussians, small(views_about(gaussians, views)), Crew(2).map)


def test_what_nobody_sees_goes_first(ball):
    found = remover(ball, 8).prune_to(350)
    distance = np.linalg.norm(found.gaussians.means, axis=1)
    assert found.left_out == 550 and (distance > 0.9).mean() > 0.9
    assert psnr(found.gaussians, ball, small(views_about(ball, 8))) == pytest.approx(found.psnr, abs=0.1)


def test_colours_make_up_for_what_went_at_views_that_nobody_looked_at(ball):
    haze = replace(ball, opacities=np.full(900, 0.2), scales=2 * ball.scales, sh=0.3 * ball.means[:, None])
    found = remover(haze, 20).prune_to(400)
    corrected, as_it_was = (psnr(one, haze, around(haze)) for one in (found.gaussians, haze.taken(found.rows)))
    assert corrected > as_it_was


def test_a_higher_worth_leaves_out_more_and_costs_more():
    cloud = make_list(800, 1, np.random.default_rng(3))
    ranked = remover(cloud, 6)
    pruned = [ranked.prune(worth) for worth in (0.0, 0.02, 0.2, 1e9)]
    left = [one.left_out for one in pruned]
    assert left[0] == 0 and left[0] < left[1] < left[2] < left[3] < 800
    assert pruned[1].psnr > pruned[2].psnr
    assert all(set(more.rows) > set(fewer.rows) for more, fewer in pairwise(pruned))  # what goes does not come back
    few = ranked.prune_to(60).rows
    assert few.size == 60 and (ranked.costliest(np.arange(800), 60) == few).all()
    assert set(few) < set(pruned[2].rows) and (pruned[1].rows[ranked.costliest(pruned[1].rows, 60)] == few).all()
    assert ranked.worth_at(30) > ranked.worth_at(50) > 0


def test_nothing_depends_on_threads(ball):
    assert ts.Runtime(threads=1).compress(ball) == ts.Runtime(threads=3).compress(ball)


def test_compress_leaves_out_says_so_and_keeps_all_where_asked(ball):
    stats = EncodeStats()
    data, whole = ts.Runtime().compress(ball, stats=stats), ts.compress(ball, keep_all=True)
    thin = ts.decompress(data)
    assert 0 < stats.left_out == 900 - thin.count
    assert ts.decompress(whole).count == 900 and len(data) < len(whole)
    about = ts.inspect(data)
    assert about["pruned"] == thin.notes.pruned
    assert tells(about["pruned"], f"{stats.left_out} 900")
    assert ts.inspect(whole)["pruned"] is None
    # all of them, in as many bytes by coarser steps, would look worse
    coarse = ts.decompress(ts.compress(ball, keep_all=True, target_size=len(data)))
    assert psnr(thin, ball, around(ball)) > psnr(coarse, ball, around(ball))


def test_targets_are_met_without_what_is_left_out(ball):
    data = ts.compress(ball, target_size=5000)
    assert 2500 < len(data) <= 5000 and ts.decompress(data).count < 900


@pytest.mark.parametrize(
    ("text", "amount"),
    [
        ("0.5", Amount(share=0.5)),
        ("45dB", Amount(psnr=45.0)),
        ("40.5db", Amount(psnr=40.5)),
        ("2e5", Amount(count=200000)),
    ],
)
def test_amounts_have_three_forms(text, amount):
    assert Amount.of(text) == amount


@pytest.mark.parametrize("text", ["", "0", "1.5", "-3", "nan", "inf", "0dB", "1000dB", "half"])
def test_other_amounts_are_refused(text):
    with pytest.raises(InputError) as caught:
        Amount.of(text)
    assert caught.value.where == "prune" and (text in str(caught.value))


def test_amounts_are_met(ball):
    assert leave_out(ball, Amount(share=0.25), 2).gaussians.count == 675
    assert leave_out(ball, Amount(count=250), 2).gaussians.count == 250
    assert leave_out(ball, Amount(count=5000), 2).gaussians.count == 900
    found = leave_out(ball, Amount(psnr=36.0), 2)
    assert found.psnr >= 36.0 and found.left_out > leave_out(ball, Amount(psnr=42.0), 2).left_out


def test_gaussians_with_pixels_are_looked_at_from_their_own_cameras():
    gaussians = make_gaussians(2, 16, 24, degree=1)
    found = leave_out(gaussians, Amount(share=0.5), 1)
    assert found.gaussians.count == gaussians.count // 2 and not found.gaussians.cameras


def test_every_format_takes_what_is_left(ball, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    source = tmp_path / "ball.npz"
    ts.save_gaussians(source, ball)
    for name in ("b.spz", "b.npz", "b.tsplat"):
        assert main(["convert", str(source), "-o", str(tmp_path / name), "--prune", "0.5"]) == 0
        assert tells(capsys.readouterr().out, "450 900")
        assert ts.load_gaussians(tmp_path / name).count == 450
    assert main(["convert", str(tmp_path / "b.tsplat"), "-o", str(tmp_path / "again.tsplat")]) == 0
    assert ts.load_gaussians(tmp_path / "again.tsplat").count == 450  # pruned once
    assert main(["decode", str(tmp_path / "b.tsplat"), "-o", str(tmp_path / "few.npz"), "--prune", "100"]) == 0
    assert ts.load_gaussians(tmp_path / "few.npz").count == 100
    assert main(["info", str(tmp_path / "b.tsplat")]) == 0
    assert tells(capsys.readouterr().out, "450 900")
    assert main(["compress", str(source), "-o", str(tmp_path / "c.tsplat"), "--keep-all"]) == 0
    assert ts.load_gaussians(tmp_path / "c.tsplat").count == 900


def test_converted_lists_are_pruned_unless_all_are_to_be_kept(ball, tmp_path: Path):
    source, file = tmp_path / "ball.npz", tmp_path / "b.tsplat"
    ts.save_gaussians(source, ball)
    for options, kept in (({}, False), ({"keep_all": True}, True)):
        ts.convert(source, file, **options)
        assert (ts.load_gaussians(file).count == ball.count) is kept
    pixels = make_gaussians(2, 16, 24, degree=1)
    exact = tmp_path / "exact.tsplat"
    exact.write_bytes(ts.compress(pixels, lossless=True))
    for whole, count in ((source, ball.count), (exact, pixels.count)):
        ts.convert(whole, file, prune=0.5)  # what is left of it stays
        assert ts.load_gaussians(file).count == pytest.approx(count / 2, abs=1)


_WITHOUT = """
import sys
sys.modules["numba"] = None
from tinysplat_runtime.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_without_numba_all_are_kept_and_one_line_says_so(ball, tmp_path: Path):
    source, file = tmp_path / "ball.npz", tmp_path / "b.tsplat"
    ts.save_gaussians(source, ball.taken(np.arange(200)))

    def run(*words: object) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", _WITHOUT, *map(str, words)]
        return subprocess.run(command, capture_output=True, text=True, timeout=120)

    done = run("compress", source, "-o", file, "-q")
    assert done.returncode == 0 and done.stderr.count("\n") == 1
    assert "numba" in done.stderr
    assert ts.load_gaussians(file).count == 200
    assert run("compress", source, "-o", file, "-q", "--keep-all", "--force").stderr == ""
    refused = run("convert", source, "-o", tmp_path / "b.npz", "--prune", "0.5")
    assert refused.returncode == 2 and tells(refused.stderr, "--prune") and "numba" in refused.stderr
    assert refused.stderr.count("\n") == 1
