"""What is pinned on purpose, and rewritten by `make golden`: the plane encoder's bytes, what whole files decode to,
what commands say of faults that users meet, and the contracts of graphs."""

import numpy as np
import pytest
from golden.cases import DATA, FILES, golden_contracts, golden_messages, golden_planes

import tinysplat_runtime as ts
from tinysplat_runtime.codec.hevc import encode_plane
from tinysplat_runtime.codec.profiles import EncoderSettings
from tinysplat_runtime.gaussian.gaussians import FIELDS


@pytest.mark.parametrize("name", golden_planes())
def test_integer_planes_code_to_the_golden_bytes(name):
    codes, qp = golden_planes()[name]
    coded = encode_plane(codes, qp, EncoderSettings("medium"))
    assert coded.parameter_sets + coded.payload == (DATA / f"{name}.hevc").read_bytes()


@pytest.mark.parametrize("case", FILES, ids=lambda case: case.name)
def test_golden_files_decode_to_the_golden_gaussians(case):
    decoded = ts.decompress((DATA / f"{case.name}.tsplat").read_bytes())
    golden = np.load(DATA / f"{case.name}.npz")
    for n, layer in enumerate(decoded.layers):
        for field in FIELDS:
            wanted = golden[f"layer{n}_{field}"]
            tolerance = 1e-6 * max(1.0, float(np.abs(wanted).max()))
            np.testing.assert_allclose(getattr(layer, field), wanted, rtol=1e-6, atol=tolerance, err_msg=field)


@pytest.mark.parametrize("case", FILES, ids=lambda case: case.name)
def test_golden_files_are_still_what_the_encoder_writes_up_to_rounding(case):
    wanted = (DATA / f"{case.name}.tsplat").read_bytes()
    found = case.code(case.make(), case.profile, case.qp)
    described, golden = ts.inspect(found), ts.inspect(wanted)
    assert described["metadata_bytes"] == golden["metadata_bytes"]
    assert len(found) == pytest.approx(len(wanted), rel=0.02)
    assert [p["name"] for p in described["planes"]] == [p["name"] for p in golden["planes"]]
    _assert_alike(ts.decompress(found), ts.decompress(wanted))


@pytest.mark.parametrize(("name", "found"), [("messages", golden_messages), ("contracts", golden_contracts)])
def test_messages_and_contracts_are_those_that_were_reviewed(name, found):
    assert found() == (DATA / f"{name}.txt").read_text(encoding="utf-8")


def _assert_alike(found: ts.Gaussians, wanted: ts.Gaussians) -> None:
    """Attributes differ by no more than codes that fell on the other side of a rounding: a share of their spread."""
    for a, b in zip(found.layers, wanted.layers, strict=True):
        for field in FIELDS:
            difference, spread = np.subtract(getattr(a, field), getattr(b, field)), np.std(getattr(b, field))
            error = float(np.sqrt(np.square(difference).mean()))
            assert error <= 0.01 * float(spread), f"{field}: {error:.3g} of a spread of {spread:.3g}"
