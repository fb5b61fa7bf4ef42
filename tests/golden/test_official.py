"""The official networks against tensors made with the authors' implementations.

One test per tensor, in the order of computation, so that the first failure shows where a break starts. Tolerances
are the fixtures' own: ten times the rounding measured between single and double precision of the reference.
"""

import json

import numpy as np
import pytest
import torch
from golden.official.check_golden import compare, load_fixture
from golden.official.networks import (
    FOLDER,
    MAPPING,
    deterministic_network,
    manifest,
    network_inputs,
    network_name,
    run_fixture,
)

from tinysplat.networks import build
from tinysplat.networks.harmonics import official_to_standard

FIXTURES = sorted(path.stem for path in (FOLDER / "golden").glob("*.npz"))
MODELS = sorted(path.stem for path in (FOLDER / "manifests").glob("*.json"))
"""Of these depthsplat_large_re10k has no fixture; its structure is that of base."""


def _cases() -> list[tuple[str, str]]:
    cases = []
    for fixture in FIXTURES:
        with np.load(FOLDER / "golden" / f"{fixture}.npz") as archive:
            names = json.loads(str(archive["meta"]))["tensors"]
        cases += [(fixture, name) for name in sorted(names, key=lambda name: name.startswith("out/"))]
    return cases


@pytest.mark.parametrize("model", MODELS)
def test_state_dict_has_exactly_the_official_names_and_shapes(model: str) -> None:
    with torch.device("meta"):  # shapes alone
        network = build(*network_name(model))
    assert {name: list(tensor.shape) for name, tensor in network.state_dict().items()} == manifest(model)


@pytest.mark.parametrize(("fixture", "tensor"), _cases())
def test_tensor_matches_the_official_implementation(fixture: str, tensor: str) -> None:
    _, expected, meta = load_fixture(FOLDER / "golden" / f"{fixture}.npz")
    found = run_fixture(fixture)
    ((_, status, largest, mean, atol),) = compare({tensor: expected[tensor]}, meta, {tensor: found[tensor]})
    assert status == "ok", f"largest difference {largest:.3g}, mean {mean:.3g}, allowed {atol:.3g}"


@pytest.mark.parametrize(("degree", "key"), [(2, "deg2_exact"), (3, "deg3_exact"), (4, "deg4_consistent")])
def test_sh_mapping_follows_from_the_polynomials(degree: int, key: str) -> None:
    np.testing.assert_allclose(official_to_standard(degree), MAPPING[f"official_to_standard_{key}"], atol=1e-10)


def test_default_mvsplat_output_is_the_exact_degree_3_mapping() -> None:
    fixture = "mvsplat_re10k_v2_64x64"
    inputs, expected, meta = load_fixture(FOLDER / "golden" / f"{fixture}.npz")
    sh = deterministic_network("mvsplat_re10k")(*network_inputs(inputs)).sh.flatten(1, 3).numpy()
    stride = meta["tensors"]["out/harmonics"]["stride"][1]
    mapping = np.array(MAPPING["official_to_standard_deg3_exact"])
    want = np.einsum("kj,bncj->bnkc", mapping, expected["out/harmonics"][..., :16])
    np.testing.assert_allclose(sh[:, ::stride], want, atol=2 * meta["tensors"]["out/harmonics"]["atol"])
