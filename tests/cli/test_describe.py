"""What `info` prints, line by line."""

from __future__ import annotations

import json
from pathlib import Path

import console
import numpy as np
import pytest
from scenes import free_in_tiers, make_free_gaussians, make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.cli.describe import describe_gaussians, gaussians_text


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
        "file": file,
        "bytes": Path(file).stat().st_size,
        "gaussians": g.count,
        "sh_degree": 1,
        "views": [[24, 16], [24, 16]],
        "layers": 2,
        "notes": {"unit": "metre"},
    }
    assert json.loads(console.succeed("info", file, "--json")) == about
    assert console.succeed("info", file) == gaussians_text(about) + "\n"


def in_rows(text: str, heading: str) -> list[list[str]]:
    """Words of the rows under a heading, up to an empty line."""
    return [line.split() for line in text.partition(f"\n{heading}")[2].partition("\n\n")[0].splitlines()[1:]]


FILES = {
    "planes": lambda: ts.compress(make_smooth_gaussians(2, 16, 24, degree=1).with_notes(ts.Notes(unit="metre"))),
    "lossless": lambda: ts.compress(make_smooth_gaussians(2, 16, 24), lossless=True),
    "capture": lambda: ts.compress(make_smooth_gaussians(14, 8, 16)),
    "list": lambda: free_in_tiers(make_free_gaussians(300, 1, np.random.default_rng(1))),
}


@pytest.mark.parametrize("name", FILES)
def test_info_of_a_file_is_its_description_in_text_or_json(tmp_path: Path, name: str) -> None:
    """Every number stands in its row, and classes, metadata and views add up to the file."""
    file, data = tmp_path / "f.tsplat", FILES[name]()
    file.write_bytes(data)
    about, text = ts.inspect(data), console.succeed("info", file)
    assert json.loads(console.succeed("info", file, "--json")) == json.loads(json.dumps(about))
    first, second = text.splitlines()[:2]
    assert first.startswith(f"{file}: {len(data)} bytes, ") and f"mode {about['mode']}, profile" in first
    size = "a list of" if name == "list" else f"{about['views']} views of {about['width']}x{about['height']}, "
    assert size in second and f"{about['gaussians']} Gaussians" in second
    assert f"SH degree {about['sh_degree']}" in second
    assert ("unit: metre" in text.splitlines()) == (name == "planes")
    rows = in_rows(text, "class ")
    sizes = {**about["bytes_by_class"], "metadata": about["metadata_bytes"]}
    assert {row[0]: int(row[1]) for row in rows} == sizes and sum(sizes.values()) == len(data)
    assert all(row[2] == f"{sizes[row[0]] / len(data):.1%}" for row in rows)
    views = about["bytes_by_view"]
    if name == "capture":
        spread = {"least": min(views), "median": sorted(views)[6], "most": max(views)}
        assert in_rows(text, "views ") == [[word, str(n), "view", str(views.index(n))] for word, n in spread.items()]
    else:
        assert in_rows(text, "view ") == [[str(view), str(n)] for view, n in enumerate(views)]
    for row, plane in zip(in_rows(text, "layer plane"), about["planes"], strict=True):
        assert [int(row[0]), *row[1:3], int(row[-1])] == [plane[key] for key in ("layer", "name", "coding", "bytes")]
    shown, told = [int(row[0]) for row in in_rows(text, "a prefix of")], [p["bytes"] for p in about["prefixes"]]
    assert shown == told if name != "capture" else {told[0], told[-1]} <= set(shown) <= set(told)
