"""What `info` says of a file: the numbers of its description, as text and as JSON."""

import json
from pathlib import Path

import console
import numpy as np
import pytest
from scenes import list_in_tiers, make_list, make_smooth_gaussians

import tinysplat_runtime as ts


def test_other_files_are_described_and_their_extent_is_in_the_world(tmp_path: Path) -> None:
    g = make_smooth_gaussians(2, 16, 24, degree=1, layers=2, origin=(100, 0, 0)).with_notes(ts.Notes(unit="metre"))
    file = str(tmp_path / "g.npz")
    ts.save_gaussians(file, g)
    about = json.loads(console.succeed("info", file, "--json"))
    means = np.concatenate([layer.means.reshape(-1, 3) + layer.origin for layer in g.layers])
    scales = np.concatenate([layer.scales.ravel() for layer in g.layers])
    opacities = np.concatenate([layer.opacities.ravel() for layer in g.layers])
    assert means.min() < -0.5 and means.max() > 90
    size = Path(file).stat().st_size
    plain = (file, size, g.count, 1, [[24, 16], [24, 16]], 2, {"unit": "metre"})
    assert all(told in about.values() for told in plain)
    measured = ([means.min(axis=0), means.max(axis=0)], np.median(scales), np.median(opacities))
    numbers = [np.array(value) for value in about.values() if not isinstance(value, str | dict)]
    for told in map(np.array, measured):
        assert any(told.shape == one.shape and np.allclose(one, told, atol=1e-5) for one in numbers)
    text = console.succeed("info", file)
    assert all(str(told) in text for told in (file, g.count, size, "24x16", "metre"))


FILES = {
    "planes": lambda: ts.compress(make_smooth_gaussians(2, 16, 24, degree=1).with_notes(ts.Notes(unit="metre"))),
    "lossless": lambda: ts.compress(make_smooth_gaussians(2, 16, 24), lossless=True),
    "capture": lambda: ts.compress(make_smooth_gaussians(14, 8, 16)),
    "list": lambda: list_in_tiers(make_list(300, 1, np.random.default_rng(1))),
}


@pytest.mark.parametrize("name", FILES)
def test_info_of_a_file_is_its_description_in_text_or_json(tmp_path: Path, name: str) -> None:
    """A row of text has every class and plane with its bytes; classes and metadata add up to the file."""
    file, data = tmp_path / "f.tsplat", FILES[name]()
    file.write_bytes(data)
    about, text = ts.inspect(data), console.succeed("info", file)
    assert json.loads(console.succeed("info", file, "--json")) == json.loads(json.dumps(about))
    sizes = {**about["bytes_by_class"], "metadata": about["metadata_bytes"]}
    assert sum(sizes.values()) == len(data)
    rows = [set(line.split()) for line in text.splitlines()]
    shown = [[plane[key] for key in ("layer", "name", "coding", "bytes")] for plane in about["planes"]]
    views = about["bytes_by_view"]
    spread = [min(views), sorted(views)[(len(views) - 1) // 2], max(views)] if name == "capture" else views
    for told in (*sizes.items(), *shown, *([view, views[view]] for view in map(views.index, spread))):
        assert any(set(map(str, told)) <= row for row in rows), told
    assert all(str(told) in text for told in (file, len(data), about["mode"], about["gaussians"], about["sh_degree"]))
    seen = map(str, about["tiers"]) if name == "list" else [f"{about['width']}x{about['height']}"]
    assert all(told in text for told in seen)
    assert ("metre" in text) == (name == "planes")
    prefixes = {str(prefix["bytes"]) for prefix in about["prefixes"]}
    assert (prefixes if name != "capture" else {str(about["prefixes"][-1]["bytes"])}) <= set().union(*rows)
