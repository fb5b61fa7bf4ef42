"""Memory is used again once its last view is gone, and never before."""

from __future__ import annotations

import gc

import numpy as np

from tinysplat_runtime.system.buffers import Recycler


def address(array):
    return array.__array_interface__["data"][0]


def test_memory_comes_back_when_the_last_view_is_gone():
    recycler = Recycler()
    (first,) = recycler.empty([(3, 5)])
    first[:] = 7
    view, place = first.T[2:], address(first)
    del first
    gc.collect()
    (second,) = recycler.empty([(3, 5)])
    assert address(second) != place
    second[:] = 1
    assert (view == 7).all()
    del view, second
    gc.collect()
    third = recycler.empty([(15,), (3, 5)])
    assert place in {address(array) for array in third}
    assert third[0].dtype == np.float32 and third[0].shape == (15,)


def test_memory_of_another_size_is_not_taken():
    recycler = Recycler()
    first = recycler.empty([(6,), (8,)])
    place = address(first[1])
    del first
    gc.collect()
    small, fitting, fresh = recycler.empty([(2, 2), (4, 2), (8,)])
    assert place in (address(fitting), address(fresh)) and address(fitting) != address(fresh)
    assert (small.shape, fitting.shape, fresh.shape) == ((2, 2), (4, 2), (8,))
    fitting[:], fresh[:], small[:] = 1, 2, 3
    assert (fitting == 1).all() and (fresh == 2).all()
