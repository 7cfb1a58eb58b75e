"""How loops are compiled."""

from numba.core.caching import NullCache

from lidar_buildings.core.kernels import inner_kernel, kernel


@inner_kernel
def raised(number, by):
    return number + by


@kernel
def raised_twice(number):
    return raised(raised(number, 1), 2)


@kernel
def share(part, whole):
    return part / whole


def test_literal_numbers_make_no_copies():
    raised_twice._cache = NullCache()  # what comes from the disk compiles nothing
    assert raised_twice(3) == 6
    assert len(raised.signatures) == 1


def test_loops_divide_as_numpy_does():
    assert share(1.0, 0.0) == float("inf")
