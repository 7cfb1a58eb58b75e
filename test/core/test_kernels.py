"""How loops are compiled."""

import gc
import os
import subprocess
import sys

import numpy as np
import pytest
from numba import njit
from numba.core.caching import NullCache
from numba.core.runtime import _nrt_python, rtsys
from numpy.testing import assert_array_equal

from lidar_buildings.core.kernels import kernel


@kernel
def raised(number, by):
    return number + by


@kernel
def raised_twice(number):
    return raised(raised(number, 1), 2)


@kernel
def raised_by_one(number):
    return number + 1


@kernel
def raised_from(small, large):
    return raised_by_one(small[0]) + raised_by_one(large[0])


@kernel
def share(part, whole):
    return part / whole


def test_literal_numbers_make_no_copies():
    raised_twice._cache = NullCache()  # what comes from the disk compiles nothing
    assert raised_twice(3) == 6
    assert len(raised.signatures) == 1


def test_numbers_of_32_bits_make_no_copies():
    raised_from._cache = NullCache()
    assert raised_from(np.array([3], dtype=np.int32), np.array([4])) == 9
    assert len(raised_by_one.signatures) == 1


def test_a_loop_from_a_file_is_put_into_those_that_are_compiled(tmp_path):
    """What is loaded is machine code; a loop that calls it asks for what the compiler needs."""
    script = tmp_path / "loops.py"
    script.write_text(
        "import sys\n"
        "from lidar_buildings.core.kernels import kernel\n"
        "@kernel\n"
        "def doubled(number):\n    return 2 * number\n"
        "@kernel\n"
        "def of_doubled(number):\n    return doubled(number) + 1\n"
        "if sys.argv[1] == 'first':\n    doubled(3)\n"
        "else:\n    assert doubled(3) == 6 and doubled.stats.cache_hits\n    assert of_doubled(3) == 7\n"
    )
    for turn in ("first", "second"):
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
        subprocess.run([sys.executable, str(script), turn], env=environment, check=True)


def test_loops_divide_as_numpy_does():
    assert share(1.0, 0.0) == float("inf")


@kernel
def later_part(values, begin):
    return values[begin:]


@kernel
def first_below(values, limit, begin):
    """Has several ways out, on which several of its names end."""
    rest = values[begin:]
    for i in range(len(rest)):
        if rest[i] < 0.0:
            return -1
        if rest[i] < limit:
            return begin + i
    return len(values)


@kernel
def taken_apart(values, other, n):
    """Swap, slice, keep and return arrays of both kinds: handed in, and made here."""
    one, two, kept = values, other, values[:0]
    total = 0.0
    for i in range(n):
        one, two = two, one
        if i == 3:
            kept = later_part(one, 1)
        elif i == 5:
            two = np.ones(4)
        total += first_below(one, 0.5, i % 2) + np.sum(two)
    pair = (later_part(two, 1), kept)
    return pair, total


@pytest.fixture
def _counted_allocations():
    _nrt_python.memsys_enable_stats()
    yield
    _nrt_python.memsys_disable_stats()


@pytest.mark.usefixtures("_counted_allocations")
def test_arrays_live_as_long_as_they_are_used():
    values, other = np.arange(4.0), np.arange(4.0) + 10.0
    as_numba_does = njit(taken_apart.py_func)
    gc.collect()  # what earlier tests have left must not be freed in between
    before = rtsys.get_allocation_stats()
    references = sys.getrefcount(values), sys.getrefcount(other)
    for n in range(9):
        (one, two), total = taken_apart(values, other, n)
        expected, expected_total = as_numba_does(values, other, n)
        assert_array_equal(one, expected[0])
        assert_array_equal(two, expected[1])
        assert total == expected_total
    del one, two, expected
    after = rtsys.get_allocation_stats()
    assert after.alloc - before.alloc == after.free - before.free > 0
    assert (sys.getrefcount(values), sys.getrefcount(other)) == references


def test_references_to_what_is_handed_in_are_not_counted():
    first_below_of = kernel(first_below.py_func)
    first_below_of._cache = NullCache()
    assert first_below_of(np.arange(4.0), 2.5, 1) == 1
    (code,) = first_below_of.inspect_llvm().values()
    loop = code[code.index("define") :].split("\n}")[0]
    assert "NRT_incref" not in loop
    assert "NRT_decref" not in loop
