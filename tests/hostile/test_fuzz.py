"""A fixed small set of the fuzz campaign's attacks (`hostile.campaign` runs millions), and what it found before."""

import pytest
from hostile.targets import TARGETS, attack

from tinysplat_runtime.formats.table import endings

pytestmark = pytest.mark.filterwarnings("ignore::tinysplat_runtime.errors.InputWarning")  # meant for users

SHARE = {
    "container": 1500,
    "info": 300,
    "decode": 400,
    "javascript": 400,
    "picture": 1000,
    "parameter_sets": 500,
    "photos": 60,
    "colmap": 60,
    "usd": 50,
}


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_input_is_refused_by_the_right_error_or_read_rightly(
    name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    outcomes = [attack(TARGETS[name], case) for case in range(SHARE.get(name, 150))]
    findings = [(case, o.message) for case, o in enumerate(outcomes) if o.kind == "finding"]
    assert findings == []
    assert tuple(capfd.readouterr()) == ("", "")  # libraries print from C as well
    assert sum(o.kind == "refused" for o in outcomes) > len(outcomes) // 5  # the damage does reach the checks
    assert any(o.kind == "accepted" for o in outcomes)  # and what is right is read


FOUND = {
    "network": (41, 1321, 2774, 16822),
    "transforms": (53, 839),
    "photos": (142,),
    "spz": (539,),
    "colmap": (1,),
    "sog_folder": (138, 272),
    "glb_spz": (873, 11973),
    "usd": (1739, 2638),
}
"""Attacks that were findings once: docs/lab/robustness.md, "Found and fixed"."""


@pytest.mark.parametrize("name", FOUND)
def test_what_was_found_stays_fixed(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert {attack(TARGETS[name], case).kind for case in FOUND[name]} <= {"refused", "accepted"}
    assert tuple(capfd.readouterr()) == ("", "")


def test_every_gaussian_file_that_is_read_is_attacked() -> None:
    assert {ending for target in TARGETS.values() for ending in target.endings} == set(endings(written=False))
