"""The check of columns."""

import numpy as np
import pytest

from lidar_buildings.core.model.point_array import checked_column


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint64, np.float32, np.float64])
def test_whole_numbers_come_in_any_type(dtype):
    found = checked_column("class", np.array([0, 6, 11], dtype=dtype), 3, np.uint8)
    assert found.dtype == np.uint8
    assert found.tolist() == [0, 6, 11]


@pytest.mark.parametrize(
    ("value", "dtype"),
    [
        (0.5, np.int64),
        (np.inf, np.int64),
        (-np.inf, np.uint8),
        (1e19, np.int64),
        (256, np.uint8),
        (-1, np.uint8),
    ],
)
def test_what_is_no_whole_number_of_the_type_is_refused_by_name(value, dtype):
    with pytest.raises(ValueError, match=r"roof_id\[1\] = .*whole number within"):
        checked_column("roof_id", np.array([0, value, 0]), 3, dtype)


def test_columns_of_another_length_and_nan_are_refused_by_name():
    with pytest.raises(ValueError, match=r"gps_time has shape \(2,\)"):
        checked_column("gps_time", [0.0, 1.0], 3, np.float64)
    with pytest.raises(ValueError, match=r"gps_time\[2\] = nan"):
        checked_column("gps_time", [0.0, 1.0, np.nan], 3, np.float64)
