"""Which references to arrays a loop counts, and that none is lost or left."""

import gc
import sys

import numpy as np
import pytest
from numba.core.caching import NullCache
from numba.core.runtime import _nrt_python, rtsys

from lidar_buildings.core.kernels import inner_kernel, kernel


def compiled_anew(function):
    """Compile a loop in each run: what a file holds of one cannot be looked into."""
    loop = kernel(function)
    loop._cache = NullCache()
    return loop


@inner_kernel
def _sum(values):
    total = 0.0
    for value in values:
        total += value
    return total


@compiled_anew
def sum_of_views(table):
    total = 0.0
    for i in range(len(table)):
        row = table[i]
        part = row[1:]
        total += _sum(part) + _sum(table[:, 0]) + part[0]
    return total


@compiled_anew
def longer_of(one, other):
    return one if len(one) > len(other) else other


@compiled_anew
def made_or_handed_in(values, is_made):
    found = values
    if is_made:
        found = np.zeros(3)
    for _ in range(2):
        found = found[1:]
    return found


@compiled_anew
def taken_turns(values, n):
    before, after = values, np.zeros_like(values)
    for _ in range(n):
        for i in range(len(values)):
            after[i] = before[i] + 1.0
        before, after = after, before
    return before


@compiled_anew
def chosen(values, rows):
    taken = values[rows]
    taken = taken[1:]
    return values[:2], taken, (taken, values)[1]


@inner_kernel
def _first_and_last(pair):
    values, others = pair
    return values[0] + others[-1]


@compiled_anew
def sum_of_tuples(values, others):
    total = 0.0
    for _ in range(3):
        total += _first_and_last((values, others)) + (values, 2.0)[1]
    return total


def counts(loop):
    """Return how many counts of references LLVM is left with in a loop that was called once."""
    (text,) = loop.inspect_llvm().values()
    return text.count("call void @NRT_incref")


@pytest.fixture
def balance():
    """Yields; fails unless as much of numba's memory was given back as was taken."""
    rtsys.initialize(sum_of_views.targetctx)
    gc.collect()  # what other tests left in cycles would be given back within this one
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    yield
    after = rtsys.get_allocation_stats()
    _nrt_python.memsys_disable_stats()
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free


@pytest.mark.usefixtures("balance")
def test_views_of_what_was_handed_in_are_not_counted():
    table = np.arange(12.0).reshape(4, 3)
    n_before = sys.getrefcount(table)
    assert sum_of_views(table) == table[:, 1:].sum() + 4 * table[:, 0].sum() + table[:, 1].sum()
    assert counts(sum_of_views) == 0
    assert sys.getrefcount(table) == n_before


@pytest.mark.usefixtures("balance")
def test_tuples_of_what_was_handed_in_are_not_counted():
    values, others = np.arange(3.0), np.arange(5.0)
    n_before = sys.getrefcount(values), sys.getrefcount(others)
    assert sum_of_tuples(values, others) == 3 * (0.0 + 4.0 + 2.0)
    assert counts(sum_of_tuples) == 0
    assert (sys.getrefcount(values), sys.getrefcount(others)) == n_before


@pytest.mark.usefixtures("balance")
def test_an_argument_that_is_returned_outlives_the_call():
    found = longer_of(np.full(1000, 3.0), np.zeros(10))
    np.zeros(1000)
    assert found.tolist() == [3.0] * 1000
    n_before = sys.getrefcount(found)
    again = longer_of(found, np.zeros(1))
    assert again is found
    del again
    assert sys.getrefcount(found) == n_before


@pytest.mark.usefixtures("balance")
@pytest.mark.parametrize("is_made", [False, True])
def test_a_name_of_both_kinds_is_counted(is_made):
    values = np.arange(5.0)
    n_before = sys.getrefcount(values)
    found = made_or_handed_in(values, is_made)
    assert found.tolist() == ([0.0] if is_made else [2.0, 3.0, 4.0])
    assert counts(made_or_handed_in) > 0
    del found
    assert sys.getrefcount(values) == n_before


@pytest.mark.usefixtures("balance")
@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_two_names_that_change_places_are_counted(n):
    values = np.zeros(100)
    n_before = sys.getrefcount(values)
    assert taken_turns(values, n).tolist() == [float(n)] * 100
    assert sys.getrefcount(values) == n_before


@pytest.mark.usefixtures("balance")
def test_rows_that_a_list_chooses_are_the_loops_own():
    values = np.arange(6.0)
    n_before = sys.getrefcount(values)
    view, taken, whole = chosen(values, np.array([4, 2, 5]))
    assert (view.tolist(), taken.tolist()) == ([0.0, 1.0], [2.0, 5.0])
    assert whole is values
    del view, taken, whole
    assert sys.getrefcount(values) == n_before
