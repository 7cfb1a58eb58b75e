"""How loops are compiled."""

from lidar_buildings.core.kernels import kernel


@kernel
def share(part, whole):
    return part / whole


@kernel
def doubled_share(part, whole):
    return 2.0 * share(part, whole)


def test_loops_divide_as_numpy_does():
    assert share(1.0, 0.0) == float("inf")


def test_a_loop_may_be_called_by_loops_and_by_python():
    assert doubled_share(1.0, 4.0) == 2.0 * share(1.0, 4.0)
