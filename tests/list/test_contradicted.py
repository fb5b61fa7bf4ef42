"""Which blocks of a photo the others contradict, and which pixels lie in them."""

import numpy as np

from tinysplat_runtime.list.training.contradicted import contradicted, pixels


def test_blocks_that_err_are_contradicted_and_those_beside_that_err_half_as_much() -> None:
    wrong = np.full((3, 20, 30), 0.1, np.float32)  # the last blocks are 4 pixels high and 6 wide
    wrong[1, 16:, 24:] = 1
    wrong[1, 8:16, 16:24] = 0.4
    wrong[1, :8, :8] = 0.4
    expected = np.zeros((3, 3, 4), bool)
    expected[1, 2, 3] = expected[1, 1, 2] = True
    np.testing.assert_array_equal(contradicted(wrong, 0.6), expected)


def test_photos_that_err_alike_contradict_nothing_nor_does_one_that_errs_in_a_corner() -> None:
    wrong = np.zeros((5, 64, 64), np.float32)
    wrong[:, :8, :16] = 1
    wrong[4, :16] = 1
    assert not np.any(contradicted(wrong, 0.6))
    wrong[:] = 0
    wrong[4, :8, :16] = 1
    assert not np.any(contradicted(wrong, 0.6))


def test_pixels_of_blocks_are_the_same_in_smaller_photos() -> None:
    blocks = np.random.default_rng(0).random((3, 4)) < 0.5
    whole = pixels(blocks, (20, 30))
    np.testing.assert_array_equal(whole, np.kron(blocks, np.ones((8, 8), bool))[:20, :30])
    np.testing.assert_array_equal(pixels(blocks, (10, 15, 3), 2), whole[::2, ::2])
    np.testing.assert_array_equal(pixels(blocks, (5, 7), 4), whole[::4, ::4][:, :7])
