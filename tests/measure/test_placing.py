"""Places found are held against known ones under the similarity that most of them agree on."""

from __future__ import annotations

import numpy as np

from tinysplat.measure.studies.placing import misplaced
from tinysplat_runtime.gaussian.quaternions import normalize_quats, quats_to_matrices


def test_a_similarity_costs_nothing_and_a_stray_place_is_as_far_off_as_it_is() -> None:
    rng = np.random.default_rng(1)
    known = rng.normal(size=(12, 3))
    turn = quats_to_matrices(normalize_quats(rng.normal(size=4)))
    found = 0.3 * known @ turn.T + [4.0, -1.0, 2.0]
    assert misplaced(found, known).max() < 1e-12
    found[5] += 0.3 * turn @ [0.0, 2.0, 0.0]
    off = misplaced(found, known)
    assert abs(off[5] - 2) < 1e-9 and np.delete(off, 5).max() < 1e-9
