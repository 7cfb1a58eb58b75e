"""Stamps from recorded times."""

import datetime

import numpy as np
import pytest

from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.io.tiling.tile_size import reading_order
from lidar_buildings.io.tiling.tile_stamps import stamp_of_time


def unix(*when):
    return int(datetime.datetime(*when, tzinfo=datetime.timezone.utc).timestamp())


def gps(*when, leaps):
    return unix(*when) - unix(1980, 1, 6) + leaps


@pytest.mark.parametrize(
    ("when", "leaps"),
    [((2022, 5, 1, 12), 18), ((2016, 12, 31, 23, 59), 17), ((2017, 1, 1), 18), ((2010, 6, 1), 15)],
)
def test_standard_time_becomes_unix_time(when, leaps):
    adjusted = gps(*when, leaps=leaps) - 1e9
    assert stamp_of_time(adjusted, is_standard=True) == unix(*when) * 10**9


def test_week_seconds_stay_as_they_are():
    assert stamp_of_time(228671.75, is_standard=False) == 228_671_750_000_000


def test_a_week_time_longer_than_a_week_is_standard_time():
    value = 306234562.0
    assert stamp_of_time(value, is_standard=False) == stamp_of_time(value, is_standard=True)


def test_standard_time_that_was_not_adjusted_is_recognised():
    full = float(gps(2022, 5, 1, leaps=18))
    assert stamp_of_time(full, is_standard=True) == unix(2022, 5, 1) * 10**9


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, -5.0, 1e12])
def test_times_that_cannot_be_are_none(value):
    assert stamp_of_time(value, is_standard=False) is None


def test_neighbouring_files_are_read_one_after_the_other():
    areas = [Rectangle(x, y, x + 1.0, y + 1.0) for x in range(4) for y in range(4)]
    order = reading_order([None, *areas])
    assert sorted(order) == list(range(17))
    assert order[0] == 0
    first_block = {(areas[k - 1].x_min, areas[k - 1].y_min) for k in order[1:5]}
    assert first_block == {(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)}
