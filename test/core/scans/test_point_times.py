"""Times of points, as drivers write them."""

import numpy as np
import pytest

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.scans.point_times import point_times

STAMP = 1_700_000_000_123_456_789
SPAN = np.linspace(0.0, 0.1, 11)


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("time", SPAN.astype(np.float32)),  # Velodyne
        ("time", (SPAN - 0.1).astype(np.float32)),  # Velodyne, counted back from the scan's end
        ("t", np.rint(SPAN * 1e9).astype(np.uint32)),  # Ouster
        ("offset_time", np.rint(SPAN * 1e9).astype(np.uint32)),  # Livox
        ("timestamp", STAMP * 1e-9 + SPAN),  # Hesai, RoboSense
        ("timestamp", STAMP + SPAN * 1e9),  # Livox
        ("timestamp", (STAMP + np.rint(SPAN * 1e9)).astype(np.int64)),
        ("time_stamp", (STAMP // 1000 + np.rint(SPAN * 1e6)).astype(np.uint64)),
        ("time", (SPAN * 1e3).astype(np.float32)),
        ("time", (SPAN * 1e6).astype(np.float32)),
    ],
)
def test_every_driver_is_understood(field, values):
    times, name = point_times({"intensity": SPAN, field: values}, STAMP)
    assert name == field
    ends = (times[[0, -1]] - STAMP) / 1e9
    begin = -0.1 if values[0] < 0 else 0.0
    np.testing.assert_allclose(ends, [begin, begin + 0.1], atol=2e-6)


def test_a_unit_that_is_given_counts():
    times, _ = point_times({"time": np.array([0.0, 1.0])}, STAMP, "ms")
    assert (times - STAMP).tolist() == [0, 1_000_000]


@pytest.mark.parametrize("columns", [{}, {"t": np.zeros(3, np.uint32)}, {"time": np.zeros(0)}])
def test_where_no_time_is_told_there_is_none(columns):
    assert point_times(columns, STAMP)[0] is None


def test_a_time_since_1970_in_single_precision_is_none():
    assert point_times({"time": (STAMP * 1e-9 + SPAN).astype(np.float32)}, STAMP) == (None, "time")


@pytest.mark.parametrize("values", [[0.0, np.nan], [1.0, 1e12], [np.inf, 0.0]])
def test_times_that_are_none_are_named(values):
    with pytest.raises(MessageError, match="field time"):
        point_times({"time": np.array(values)}, STAMP)
