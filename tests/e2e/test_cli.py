"""The installed console script, from photos to a picture, and what it says of bad input."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from console import fail, succeed
from measure.evaluation_scenes import write_eval_scene
from scenes import make_smooth_gaussians, psnr, tells

import tinysplat_runtime as ts
from tinysplat_runtime.api import DEFAULT_MODEL
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.scene.images import read_image

SCRIPT = Path(sys.executable).with_name("tinysplat")


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    return write_eval_scene(tmp_path_factory.mktemp("scene") / "plane", frames=2)


@pytest.fixture(scope="module")
def encoded(scene, tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("encoded")
    paths = {"file": folder / "s.tsplat", "report": folder / "r.json", "raw": folder / "raw.npz"}
    succeed("encode", scene, "-o", paths["file"], "--report", paths["report"], "--save-gaussians", paths["raw"])
    return paths


def test_photos_become_a_file_whose_report_adds_up(encoded):
    report = json.loads(encoded["report"].read_text())
    assert report["bytes"] == encoded["file"].stat().st_size
    assert report["bytes"] == sum(report["bytes_by_class"].values()) + report["metadata_bytes"]
    assert all(seconds >= 0 for seconds in report["seconds"].values()) and report["seconds"]
    assert (report["views"], report["height"], report["width"]) == (2, 48, 64)
    assert report["peak_rss_bytes"] > report["bytes"]
    assert set(report["error_by_attribute"]) >= set(FIELDS)
    assert set(report["clipped"]) <= set(report["bytes_by_class"])
    assert isinstance(report["left_out"], list)


def test_a_decoded_view_looks_like_the_raw_one(encoded, tmp_path):
    for name in ("file", "raw"):
        succeed("render", encoded[name], "-o", tmp_path / f"{name}.png", "--camera", "1")
    decoded, raw = (read_image(tmp_path / f"{name}.png").astype(float) / 255 for name in ("file", "raw"))
    assert decoded.shape == (48, 64, 3) and psnr(decoded, raw) > 35


def test_photo_files_go_through_every_command(scene, tmp_path):
    file, report = tmp_path / "p.tsplat", tmp_path / "r.json"
    succeed("encode", scene, "-o", file, "--mode", "photos", "--report", report)
    assert json.loads(report.read_text())["mode"] == "photos"
    assert DEFAULT_MODEL in succeed("info", file)
    succeed("decode", file, "-o", tmp_path / "g.npz", "--report", report, "--force")
    assert json.loads(report.read_text())["seconds"]["network"] > 0
    succeed("render", file, "-o", tmp_path / "x.png")


def test_the_network_for_a_file_of_photos_can_be_given(scene, tmp_path):
    own = tmp_path / "mine.onnx"
    shipped = Path(__file__).resolve().parents[2] / "models" / f"{DEFAULT_MODEL}.onnx"
    own.write_bytes(shipped.read_bytes() + b"\xd0\x7d\x01")
    file = tmp_path / "p.tsplat"
    succeed("encode", scene, "-o", file, "--mode", "photos", "--model", own)
    message = fail("decode", file, "-o", tmp_path / "g.npz")
    assert "'mine'" in message and "--model" in message
    succeed("decode", file, "-o", tmp_path / "g.npz", "--model", own)
    assert "sweep.onnx" in fail("decode", file, "-o", tmp_path / "h.npz", "--model", "sweep")


def test_quiet_commands_print_nothing(encoded, tmp_path):
    assert succeed("decode", encoded["file"], "-o", tmp_path / "g.npz", "-q") == ""


def test_gaussians_behind_their_camera_are_counted_by_view_and_can_be_dropped(tmp_path):
    g = make_smooth_gaussians(2, 5, 6)
    means, c2w = g.means.copy(), g.cameras[1].c2w
    means[1, 2, 3] = c2w[:3, 3] - c2w[:3, 2]  # one unit behind
    ts.save_gaussians(tmp_path / "g.npz", replace(g, means=means))
    message = fail("compress", tmp_path / "g.npz", "-o", tmp_path / "o.tsplat")
    assert "view 1" in message and "--drop-invalid" in message
    succeed("compress", tmp_path / "g.npz", "-o", tmp_path / "o.tsplat", "--drop-invalid")
    assert ts.decompress((tmp_path / "o.tsplat").read_bytes()).opacities[1, 2, 3] < 0.1


def test_commands_of_an_extra_that_is_not_installed_name_the_extra():
    without = "import sys; sys.modules['tinysplat'] = None; from tinysplat_runtime.cli import main; "
    without += "sys.exit(main(['eval', 'x']))"
    done = subprocess.run([sys.executable, "-c", without], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "tinysplat" in done.stderr and 'pip install "tinysplat[eval]"' in done.stderr


# ---- files as any other, words, and what a command says ------------------------------------------------------------


def test_a_tsplat_file_goes_where_any_gaussian_file_goes(encoded, tmp_path):
    coarser, turned = tmp_path / "coarser.tsplat", tmp_path / "turned.tsplat"
    succeed("compress", encoded["file"], "-o", coarser, "--qp", "12")
    assert coarser.stat().st_size < encoded["file"].stat().st_size
    succeed("convert", encoded["file"], "-o", turned, "--rotate", "x,180", "--translate", "-1,0,2.5")
    before, after = ts.load_gaussians(encoded["file"]), ts.load_gaussians(turned)
    assert after.opacities.shape == before.opacities.shape and after.extra_layers
    np.testing.assert_allclose(
        after.cameras[1].centre, before.cameras[1].centre * (1, -1, -1) + (-1, 0, 2.5), atol=1e-6
    )
    assert psnr(ts.render(after, after.cameras[1]), ts.render(before, before.cameras[1])) > 25
    # What was cut is no longer pixels of views, and goes on as a list of points.
    cut = tmp_path / "cut.tsplat"
    succeed("convert", turned, "-o", cut, "--crop", "-9,-9,-9,9,9,9")
    assert ts.inspect(cut.read_bytes())["mode"] == "list" and ts.load_gaussians(cut).count > 0


def test_standard_input_and_output_stand_for_files(encoded, tmp_path):
    def piped(data: bytes, *words: object) -> bytes:
        return subprocess.run([str(SCRIPT), *map(str, words)], input=data, capture_output=True, check=True).stdout

    file = encoded["file"].read_bytes()
    assert piped(file, "info", "-", "--json") == piped(b"", "info", encoded["file"], "--json")
    assert piped(file, "render", "-", "-o", "-").startswith(b"\x89PNG")
    ply = piped(file, "decode", "-", "-o", "-.ply")
    assert ply.startswith(b"ply") and piped(ply, "render", "-", "-o", "-", "--size", "64x48").startswith(b"\x89PNG")
    assert piped(piped(file, "decode", "-", "-o", "-.npz"), "compress", "-", "-o", "-").startswith(b"\x89TSPLAT")


def test_nothing_is_overwritten_without_being_told_to(encoded, tmp_path):
    target = tmp_path / "a.png"
    succeed("render", encoded["file"], "-o", target)
    before = target.read_bytes()
    assert "--force" in fail("render", encoded["file"], "-o", target, "--camera", "1")
    assert target.read_bytes() == before
    succeed("render", encoded["file"], "-o", target, "--camera", "1", "--force")
    assert target.read_bytes() != before


def test_encode_ends_with_how_like_its_photos_it_looks(scene, tmp_path):
    said = succeed("encode", scene, "-o", tmp_path / "a.tsplat")
    gaussians = ts.load_gaussians(tmp_path / "a.tsplat")
    facts = (2, "64x48", gaussians.count, (tmp_path / "a.tsplat").stat().st_size, "dB")
    assert tells(said, " ".join(map(str, facts)))
