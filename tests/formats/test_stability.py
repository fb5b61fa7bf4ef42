"""What comes back of every written format stays the same numbers from release to release, rounding and order included.

Another implementation says elsewhere that they are the right ones; whoever changes how a format rounds says so here.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fingerprints import print_of

from tinysplat_runtime.formats.palette import codebook, nearest, palette
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians


def some(degree: int, count: int = 700) -> Gaussians:
    """Numbers that no matrix product is in, so that they are the same everywhere."""
    rng = np.random.default_rng(degree)
    means = rng.uniform(-1, 1, (count, 3)) * [3, 1, 20]
    sh = rng.uniform(-1, 1, (count, (degree + 1) ** 2, 3)) * 0.9
    quats = rng.uniform(-1, 1, (count, 4))
    quats[:4] = [[0, 0, 0, 1], [0, 0, -2, 0], [0, 1, 0, 0], [1, 0, 0, 0]]
    quats[4:8] = [[1, 1, 1, 1], [-1, 1, -1, 1], [0.5, 0.5, 0, 0], [0, -3, 3, 0]]
    scales = rng.uniform(0.001, 0.3, (count, 3))
    return Gaussians(means, quats, scales, rng.uniform(0, 1, count), sh)


WRITTEN = {
    "PLY": ("g.ply", {}), "compressed PLY": ("g.compressed.ply", {}), "SPZ 2": ("g.spz", {"spz_version": 2}),
    "SPZ 3": ("g.spz", {}), "SPZ 4": ("g.spz", {"spz_version": 4}), "SPZ of few bits": ("g.spz", {"sh_bits": (3, 2)}),
    "glTF": ("g.glb", {}), "glTF of SPZ": ("g.gltf", {"gltf_spz": True}), "SOG": ("g.sog", {}), "USD": ("g.usda", {}),
}  # fmt: skip

PRINTS = {
    ("PLY", 0): [
        (4.040953, -0.1487938), (0.4414837, -0.006681609), (0.1531925, 0.151773),
        (0.4947456, 0.4925159), (0.4431629, -0.01256413),
    ],
    ("PLY", 3): [
        (4.159764, -0.2415414), (0.4396826, 0.0102394), (0.1529041, 0.1555739),
        (0.4897062, 0.478783), (0.4508277, 0.004320384),
    ],
    ("compressed PLY", 0): [
        (4.04093, -0.2022446), (0.4414849, 0.1834574), (0.1531915, 0.1541772),
        (0.4947899, 0.5019774), (0.4430331, -0.01354707),
    ],
    ("compressed PLY", 3): [
        (4.159846, -0.07082699), (0.4396908, 0.1789649), (0.1529028, 0.1525301),
        (0.4897199, 0.4737238), (0.450912, 0.0008011087),
    ],
    ("SPZ 2", 0): [
        (4.040953, -0.1487938), (0.4416271, 0.1128281), (0.1532187, 0.1517403),
        (0.4947899, 0.4925783), (0.4434983, -0.01274392),
    ],
    ("SPZ 2", 3): [
        (4.159764, -0.2415414), (0.4395861, 0.123624), (0.1529225, 0.1555623),
        (0.4897199, 0.4787808), (0.4503794, 0.004075502),
    ],
    ("SPZ 3", 0): [
        (4.040953, -0.1487938), (0.44148, 0.01559827), (0.1532187, 0.1517403),
        (0.4947899, 0.4925783), (0.4434983, -0.01274392),
    ],
    ("SPZ 3", 3): [
        (4.159764, -0.2415414), (0.4396796, 0.01760819), (0.1529225, 0.1555623),
        (0.4897199, 0.4787808), (0.4503794, 0.004075502),
    ],
    ("SPZ 4", 0): [
        (4.040953, -0.1487938), (0.44148, 0.01559827), (0.1532187, 0.1517403),
        (0.4947899, 0.4925783), (0.4434983, -0.01274392),
    ],
    ("SPZ 4", 4): [
        (3.991002, 0.341911), (0.4410873, -0.01069969), (0.151218, 0.1516215),
        (0.4931317, 0.5058848), (0.4500472, -0.0003281668),
    ],
    ("SPZ of few bits", 0): [
        (4.040953, -0.1487938), (0.44148, 0.01559827), (0.1532187, 0.1517403),
        (0.4947899, 0.4925783), (0.4434983, -0.01274392),
    ],
    ("SPZ of few bits", 3): [
        (4.159764, -0.2415414), (0.4396796, 0.01760819), (0.1529225, 0.1555623),
        (0.4897199, 0.4787808), (0.4467012, 0.003564625),
    ],
    ("glTF", 0): [
        (4.040953, -0.1487938), (0.4414837, -0.006681609), (0.1531925, 0.151773),
        (0.4947456, 0.4925159), (0.4431629, -0.01256413),
    ],
    ("glTF", 3): [
        (4.159764, -0.2415414), (0.4396826, 0.0102394), (0.1529041, 0.1555739),
        (0.4897062, 0.478783), (0.4508277, 0.004320384),
    ],
    ("glTF of SPZ", 0): [
        (4.040953, -0.1487938), (0.44148, 0.01559827), (0.1532187, 0.1517403),
        (0.4947899, 0.4925783), (0.4434983, -0.01274392),
    ],
    ("glTF of SPZ", 3): [
        (4.159764, -0.2415414), (0.4396796, 0.01760819), (0.1529225, 0.1555623),
        (0.4897199, 0.4787808), (0.4503794, 0.004075502),
    ],
    ("SOG", 0): [
        (4.040949, -0.202218), (0.4414877, 0.1834481), (0.153192, 0.1541773),
        (0.4947899, 0.5019774), (0.4431556, -0.01349539),
    ],
    ("SOG", 3): [
        (4.159767, -0.07079441), (0.4396961, 0.178956), (0.1529036, 0.1525334),
        (0.4897199, 0.4737238), (0.4508273, 0.0007950566),
    ],
    ("USD", 0): [
        (4.040953, -0.1487938), (0.4414837, -0.006681609), (0.1531925, 0.151773),
        (0.4947456, 0.4925159), (0.4431629, -0.01256413),
    ],
    ("USD", 4): [
        (3.991002, 0.3419109), (0.441084, 0.01614488), (0.1511172, 0.1515127),
        (0.4931503, 0.5059234), (0.4504306, -0.0002613512),
    ],
}  # fmt: skip
"""Of means, quaternions, scales, opacities and SH as they are read again."""


@pytest.mark.parametrize(("name", "degree"), PRINTS)
def test_what_comes_back_is_what_it_was(name: str, degree: int, tmp_path: Path) -> None:
    file, options = WRITTEN[name]
    if file.endswith(".usda"):
        pytest.importorskip("pxr")
    save_gaussians(tmp_path / file, some(degree), **options)
    found = load_gaussians(tmp_path / file)
    for field, wanted in zip(FIELDS, PRINTS[name, degree], strict=True):
        assert print_of(getattr(found, field)) == pytest.approx(wanted, rel=1e-5, abs=3e-6), field


def test_codebooks_and_palettes_are_what_they_were() -> None:
    rng = np.random.default_rng(0)
    values = rng.uniform(0, 1, 3000) ** 3
    assert print_of(codebook(values)) == pytest.approx((0.4027997, 0.4017953), rel=1e-6)
    assert print_of(codebook(values, 16)) == pytest.approx((0.4331066, 0.493909), rel=1e-6)
    assert print_of(nearest(values, codebook(values))) == pytest.approx((82.31633, 82.25761), rel=1e-5)
    vectors = np.round(rng.uniform(-1, 1, (2000, 6)) * [3, 1, 1, 2, 1, 1], 3).astype(np.float32)
    for size, chosen, labels in (
        (1, (0.03216517, 0.03221007), (0, 0)), (2, (0.2730981, -0.07084111), (0.5105, 0.514675)),
        (37, (0.6307873, 0.05611776), (17.2955, 17.18392)), (256, (0.723308, 0.01665298), (126.3475, 127.0375)),
    ):  # fmt: skip
        found, label = palette(vectors, size)
        assert found.shape == (size, 6)
        assert print_of(found) == pytest.approx(chosen, rel=1e-3, abs=1e-6)
        assert print_of(label) == pytest.approx(labels, rel=1e-3)
    few = np.array([[1.0, 2], [1, 2], [3, 4]], np.float32)
    found, label = palette(few, 8)
    np.testing.assert_array_equal(found[label], few)
    np.testing.assert_array_equal(codebook(np.array([3.0, 1, 3]), 4), [1, 3, 3, 3])
    assert len(codebook(np.arange(256.0))) == len(codebook(np.arange(300.0))) == 256
    np.testing.assert_array_equal(nearest(np.array([-1, 0.4, 0.6, 1.6, 9]), np.array([0.0, 1, 2])), [0, 0, 1, 2, 2])
