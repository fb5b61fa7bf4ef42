"""SOG version 2: folders and archives, palettes and codebooks, levels of detail."""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scenes import make_gaussians, refusing

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians


def some(degree: int = 3) -> Gaussians:
    made = make_gaussians(height=20, width=20, degree=degree).flat()
    sh = 0.3 * made.sh
    return Gaussians(made.means, made.quats, made.scales, made.opacities.clip(0.02, 0.98), sh)


def test_a_folder_is_read_as_the_bundle_is(tmp_path: Path) -> None:
    save_gaussians(tmp_path / "a.sog", some())
    with zipfile.ZipFile(tmp_path / "a.sog") as archive:
        archive.extractall(tmp_path / "folder")
    whole, folder = load_gaussians(tmp_path / "a.sog"), load_gaussians(tmp_path / "folder" / "meta.json")
    for name in ("means", "quats", "scales", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(folder, name))


def test_version_1_is_read_as_its_writers_meant_it(tmp_path: Path) -> None:
    """Bytes between limits, opacity as a logit, a palette of degree 3 with limits of its own."""
    made = some()
    save_gaussians(tmp_path / "meta.json", made)
    second = load_gaussians(tmp_path / "meta.json")
    meta = json.loads((tmp_path / "meta.json").read_text())
    count = meta.pop("count")
    del meta["version"]

    def octets(name: str, values: np.ndarray) -> tuple[list[float], list[float]]:
        low, high = values.min(axis=0), values.max(axis=0)
        with Image.open(tmp_path / name) as picture:
            pixels = np.full((*picture.size[::-1], 4), 255, np.uint8)
        flat = pixels.reshape(-1, 4)
        flat[:count, : values.shape[1]] = np.rint((values - low) / (high - low) * 255)
        Image.fromarray(pixels).save(tmp_path / name, lossless=True, exact=True)
        return low.tolist(), high.tolist()

    logits = np.log(second.opacities / (1 - second.opacities))
    low, high = octets("scales.webp", np.log(second.scales))
    meta["scales"] = {"shape": [count, 3], "mins": low, "maxs": high, "files": ["scales.webp"]}
    low, high = octets("sh0.webp", np.column_stack([second.sh[:, 0], logits]))
    meta["sh0"] = {"shape": [count, 1, 4], "mins": low, "maxs": high, "files": ["sh0.webp"]}
    levels = np.array(meta["shN"]["codebook"])
    with Image.open(tmp_path / "shN_centroids.webp") as image:
        picture = np.array(image)
    low, high = levels.min(), levels.max()
    picture[..., :3] = np.rint((levels[picture[..., :3]] - low) / (high - low) * 255)
    Image.fromarray(picture).save(tmp_path / "shN_centroids.webp", lossless=True, exact=True)
    meta["shN"] = {"shape": [count, 15], "mins": low, "maxs": high, "files": meta["shN"]["files"]}
    meta["means"]["shape"] = [count, 3]
    (tmp_path / "meta.json").write_text(json.dumps(meta))
    first = load_gaussians(tmp_path / "meta.json")
    np.testing.assert_array_equal(first.means, second.means)
    np.testing.assert_allclose(np.log(first.scales), np.log(second.scales), atol=0.02)
    np.testing.assert_allclose(first.opacities, second.opacities, atol=0.01)
    np.testing.assert_allclose(first.sh, second.sh, atol=0.02)
    del meta["means"]["shape"]
    (tmp_path / "meta.json").write_text(json.dumps(meta))
    with refusing(InputError, "meta.json.means.shape"):
        load_gaussians(tmp_path / "meta.json")


def test_members_of_another_compression_are_refused(tmp_path: Path) -> None:
    save_gaussians(tmp_path / "a.sog", some(0))
    with zipfile.ZipFile(tmp_path / "a.sog") as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    for compression, is_fine in ((zipfile.ZIP_DEFLATED, True), (zipfile.ZIP_BZIP2, False)):
        with zipfile.ZipFile(tmp_path / "b.sog", "w", compression) as archive:
            for name, data in files.items():
                archive.writestr(name, data)
        if is_fine:
            assert load_gaussians(tmp_path / "b.sog").count == some(0).count
        else:
            with refusing(InputError, "b.sog"):
                load_gaussians(tmp_path / "b.sog")


def levels_folder(folder: Path, **changes: Any) -> Path:
    """Two SOG folders: rows of the first show one place at two levels, the second another place; a sky besides."""
    for name, seed in (("0_0", 0), ("0_1", 1), ("env", 2)):
        (folder / name).mkdir(parents=True)
        made = make_gaussians(height=10, width=10, degree=seed, seed=seed).flat()
        save_gaussians(folder / name / "meta.json", made)
    leaves = [
        {"bound": {}, "lods": {"1": {"file": 0, "offset": 60, "count": 9}, "0": {"file": 0, "offset": 7, "count": 50}}},
        {"bound": {}, "children": [{"bound": {}, "lods": {"2": {"file": 1, "offset": 0, "count": 30}}}]},
    ]
    names = ["0_0/meta.json", "0_1/meta.json"]
    document = {"lodLevels": 3, "environment": "env/meta.json", "filenames": names, "tree": {"children": leaves}}
    (folder / "lod-meta.json").write_text(json.dumps({**document, **changes}))
    return folder


@pytest.mark.parametrize("named", [".", "lod-meta.json"])
def test_of_levels_of_detail_the_finest_rows_are_read(tmp_path: Path, named: str) -> None:
    loaded = load_gaussians(levels_folder(tmp_path / "lod") / named)
    first, second, sky = (load_gaussians(tmp_path / "lod" / name) for name in ("0_0", "0_1", "env"))
    wanted = np.concatenate([first.means[7:57], second.means[:30], sky.means])
    np.testing.assert_array_equal(loaded.means, wanted)
    assert loaded.degree == 2 and not loaded.sh[:80, 4:].any()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"filenames": 5}, "SOG"),
        ({"filenames": ["../0_0/meta.json", "b"]}, "filenames"),
        ({"tree": {"children": []}}, "lod-meta.json"),
        ({"tree": {"lods": {"0": {"file": 5, "offset": 0, "count": 1}}}}, "file 5"),
        ({"tree": {"lods": {"0": {"file": 0, "offset": 190, "count": 11}}}}, "rows 190 to 201"),
        ({"tree": [1]}, "lod-meta.json"),
    ],
)
def test_damaged_levels_are_one_line(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    with refusing(InputError, words):
        load_gaussians(levels_folder(tmp_path / "lod", **changes))


def test_levels_that_show_the_same_rows_again_and_again_take_no_more_memory_than_allowed(tmp_path: Path) -> None:
    leaf = {"lods": {"0": {"file": 0, "offset": 0, "count": 200}}}
    folder = levels_folder(tmp_path / "lod", tree={"children": [leaf] * 1000})
    with refusing(InputError, "0 200"):
        load_gaussians(folder, max_bytes=1 << 20)
