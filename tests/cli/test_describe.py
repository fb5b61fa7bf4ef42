"""What `info` prints, line by line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import console
import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.cli.describe import describe_gaussians, gaussians_text, info_text


def described(**fields: Any) -> dict[str, Any]:
    """What `inspect` might say of a file of 1000 bytes."""
    planes = [
        {"layer": 0, "name": "depth", "coding": "fine", "qp": -3, "step": 0.012345, "bytes": 400},
        {"layer": 1, "name": "opacity", "coding": "constant", "value": 0.123456, "bytes": 12},
    ]
    plain = {
        "bytes": 1000, "version": "1.2", "mode": "gaussians", "profile": "balanced", "qp": -2.5, "views": 2,
        "width": 64, "height": 48, "gaussians": 6144, "layers": [{}, {}], "sh_degree": 1, "k": 4, "network": None,
        "notes": {"unit": "metre", "crs": ""}, "refined": None, "antialiased": False, "thinned": None, "tiers": [7],
        "bytes_by_class": {"depth": 400, "opacity": 12}, "metadata_bytes": 88, "bytes_by_view": [300, 112],
        "planes": planes, "prefixes": [{"bytes": 500, "layer": 0, "adds": ["depth", "colour"]}], "left_out": [],
    }  # fmt: skip
    return {**plain, **fields}


TEXT = """\
f.tsplat: 1000 bytes, format 1.2, mode gaussians, profile balanced, Q_g -2.5
2 views of 64x48, 6144 Gaussians in 2 layers, SH degree 1, k = 4
unit: metre

class        bytes   share
depth          400   40.0%
opacity         12    1.2%
metadata        88    8.8%

view         bytes
0              300
1              112

layer plane       coding    QP         step    bytes
    0 depth       fine      -3      0.01235      400
    1 opacity     constant   –  = 0.1235          12

a prefix of  adds
        500  layer 0: depth, colour"""


def test_a_file_is_a_page_of_text() -> None:
    assert info_text("f.tsplat", described()) == TEXT


def changed(**fields: Any) -> list[str]:
    """The lines that a file with these fields has and the plain one has not."""
    lines = info_text("f.tsplat", described(**fields)).split("\n")
    return [line for line in lines if line not in TEXT.split("\n")]


NETWORK = {"name": "sweep", "sha256": "ab12", "near": 0.5, "far": 100.0}


@pytest.mark.parametrize(
    ("fields", "lines"),
    [
        ({"refined": "10 steps"}, ["refined: 10 steps"]),
        ({"antialiased": True}, ["antialiased: yes"]),
        ({"thinned": "3 of 4"}, ["Gaussians: 3 of 4"]),
        ({"tiers": [7, 12345]}, ["tiers: 7 + 12,345"]),
        ({"gaussians": None}, ["2 views of 64x48"]),
        ({"views": 0}, ["6144 Gaussians of SH degree 1, k = 4, that belong to no pixels"]),
        (
            {"network": NETWORK, "photos": {"width": 64, "height": 48, "qp": 22, "bytes": 777}},
            ["network sweep, sha256 ab12, near 0.5, far 100", "photos of 64x48 at QP 22: 777 bytes"],
        ),
        (
            {"left_out": [{"layer": 1, "what": "sh 2", "why": "constant", "share": 0.01234, "planes": 3}]},
            ["left out", "  layer 1: sh 2 (constant, share 0.0123, planes 3)"],
        ),
        ({"left_out": [{"layer": 0, "what": "depth"}]}, ["left out", "  layer 0: depth ()"]),
        ({"prefixes": []}, []),
    ],
)
def test_what_a_file_has_besides_has_lines_of_its_own(fields: dict[str, Any], lines: list[str]) -> None:
    assert changed(**fields) == lines


def test_files_without_bytes_by_view_list_none() -> None:
    text = info_text("f.tsplat", described(bytes_by_view=[]))
    assert text == TEXT.replace("view         bytes\n0              300\n1              112\n\n", "")


def test_up_to_twelve_views_are_listed_and_more_are_summed_up() -> None:
    twelve = info_text("f.tsplat", described(views=12, bytes_by_view=[*range(100, 112)]))
    assert "\nview         bytes\n0              100\n" in twelve and "\n11             111\n" in twelve
    sizes = [9, 8, 7, 6, 5, 10, 11, 12, 13, 4, 14, 15, 16]
    lines = [
        "views        bytes",
        "least            4  view 9",
        "median          10  view 5",
        "most            16  view 12",
    ]
    assert changed(views=13, bytes_by_view=sizes) == [
        "13 views of 64x48, 6144 Gaussians in 2 layers, SH degree 1, k = 4",
        *lines,
    ]
    even = info_text("f.tsplat", described(bytes_by_view=[*sizes, 17]))
    assert "\nmedian          10  view 5\n" in even  # of 14, the lower one of the two in the middle


def test_of_many_views_constant_planes_are_not_said_again() -> None:
    left_out = [{"layer": 0, "what": "a", "why": "constant"}, {"layer": 0, "what": "b", "why": "small"}]
    for views, shown in ((12, ["  layer 0: a (constant)", "  layer 0: b (small)"]), (13, ["  layer 0: b (small)"])):
        lines = info_text("f.tsplat", described(views=views, left_out=left_out)).split("\n")
        assert lines[lines.index("left out") + 1 :] == shown
    assert "left out" not in info_text("f.tsplat", described(views=13, left_out=left_out[:1]))


@pytest.mark.parametrize(
    ("count", "ends"), [(1, [0]), (2, [0, 1]), (4, [0, 1, 2, 3]), (9, [0, 1, 3, 5, 8]), (100, [0, 24, 49, 74, 99])]
)
def test_prefixes_of_many_views_are_shown_by_quarters(count: int, ends: list[int]) -> None:
    prefixes = [{"bytes": 1000 + n, "views": n + 1} for n in range(count)]
    text = info_text("f.tsplat", described(prefixes=prefixes))
    assert text.split("adds\n")[1].split("\n") == [f"{1000 + n:11}  views up to {n}" for n in ends]


def test_other_files_are_four_lines_and_their_extent_is_in_the_world(tmp_path: Path) -> None:
    g = make_smooth_gaussians(2, 16, 24, degree=1, layers=2, origin=(100, 0, 0)).with_notes(ts.Notes(unit="metre"))
    file = str(tmp_path / "g.npz")
    ts.save_gaussians(file, g)
    about = describe_gaussians(file)
    means = np.concatenate([layer.means.reshape(-1, 3) + layer.origin for layer in g.layers])
    scales = np.concatenate([layer.scales.ravel() for layer in g.layers])
    opacities = np.concatenate([layer.opacities.ravel() for layer in g.layers])
    np.testing.assert_allclose(about["box"], [means.min(axis=0), means.max(axis=0)], atol=1e-5)
    assert means.min() < -0.5 and means.max() > 90
    assert about["median_scale"] == pytest.approx(np.median(scales))
    assert about["median_opacity"] == pytest.approx(np.median(opacities))
    plain = {key: about[key] for key in ("file", "bytes", "gaussians", "sh_degree", "views", "layers", "notes")}
    assert plain == {
        "file": file, "bytes": Path(file).stat().st_size, "gaussians": g.count, "sh_degree": 1,
        "views": [[24, 16], [24, 16]], "layers": 2, "notes": {"unit": "metre"},
    }  # fmt: skip
    assert json.loads(console.succeed("info", file, "--json")) == about
    assert console.succeed("info", file) == gaussians_text(about) + "\n"


def test_the_text_of_other_files() -> None:
    about = {
        "file": "a.ply", "format": "3DGS PLY", "bytes": 17, "gaussians": 3, "sh_degree": 2, "views": [],
        "box": [[-1.23456, 0, 1e-7], [2, 3.5, 4]], "median_scale": 0.0123456, "median_opacity": 0.98765,
        "notes": {"unit": "metre"},
    }  # fmt: skip
    assert gaussians_text(about) == (
        "a.ply: 3DGS PLY, 17 bytes\n3 Gaussians of SH degree 2, no views\n"
        "(-1.235, 0, 1e-07) to (2, 3.5, 4); medians: scale 0.01235, opacity 0.988\nunit: metre"
    )
    assert "degree 2, 2 views of 8x6\n" in gaussians_text({**about, "views": [[8, 6], [9, 9]]})


def test_info_of_a_file_is_its_description_in_text_or_json(tmp_path: Path) -> None:
    (tmp_path / "f.tsplat").write_bytes(ts.compress(make_smooth_gaussians(2, 16, 24)))
    about = ts.inspect((tmp_path / "f.tsplat").read_bytes())
    assert json.loads(console.succeed("info", tmp_path / "f.tsplat", "--json")) == json.loads(json.dumps(about))
    assert console.succeed("info", tmp_path / "f.tsplat") == info_text(str(tmp_path / "f.tsplat"), about) + "\n"
