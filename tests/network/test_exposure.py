"""One exposure over a capture: known gains and offsets come back, and what tells nothing changes nothing."""

from itertools import pairwise

import numpy as np

from tinysplat_runtime.network.exposure import Exposures, Pair, one_exposure

VIEWS, CELLS = 9, 400


def found_of(gains: np.ndarray, offsets: np.ndarray, sound: float = 1.0) -> Exposures:
    """Exposures of photos in a row, each of which shows with its two neighbours what the others do, altered."""
    random = np.random.default_rng(1)
    near = [[u for u in (v - 1, v + 1, v - 2, v + 2) if 0 <= u < len(gains)][:2] for v in range(len(gains))]
    pairs = []
    for v, partners in enumerate(near):
        for u in partners:
            true = random.random((CELLS, 3)) * 0.6 + 0.2
            here, there = true * gains[v] + offsets[v], true * gains[u] + offsets[u]
            pairs.append(Pair(v, u, here, there, np.full(CELLS, sound), CELLS))
    return one_exposure(pairs, near)


def test_one_odd_photo_is_brought_to_the_others() -> None:
    gains, offsets = np.ones((VIEWS, 3)), np.zeros((VIEWS, 3))
    gains[4] = (0.6, 0.7, 0.6)
    found = found_of(gains, offsets)
    photo = np.full((3, 2, 2), 0.5, np.float32) * gains[4][:, None, None]
    for shown in (found.shown(photo, 4), found.matched(photo, 4)):
        np.testing.assert_allclose(shown, 0.5, atol=0.03)
    np.testing.assert_allclose(found.shown(np.full((3, 2, 2), 0.5, np.float32), 0), 0.5, atol=0.01)


def test_what_drifts_is_matched_in_one_exposure_and_shown_in_its_own() -> None:
    gains = np.linspace(1, 0.7, VIEWS)[:, None] * np.ones(3)
    found = found_of(gains, np.zeros((VIEWS, 3)))
    photos = [np.float32(0.5 * gain)[:, None, None] * np.ones((3, 2, 2), np.float32) for gain in gains]
    matched = [found.matched(photo, v) for v, photo in enumerate(photos)]
    np.testing.assert_allclose(matched[0], photos[0], atol=1e-6)  # which stays as it is
    steps = [np.abs(a - b).max() for a, b in pairwise(matched)]
    assert max(steps) < 0.5 * 0.5 * (gains[0, 0] - gains[1, 0])
    np.testing.assert_allclose([found.shown(p, v)[:, 0, 0] for v, p in enumerate(photos)], 0.5 * gains, atol=0.01)
