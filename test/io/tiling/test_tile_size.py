from functools import cache

import numpy as np
import pytest

from lidar_buildings.io.tiling.tile_grid import BUFFER_SHARES, Rectangle
from lidar_buildings.io.tiling.tile_size import bounds_of, expected_points, fitting_tiles, tiles_for
from lidar_buildings.io.tiling.tiling_config import TilingConfig

#: Points per m².
DENSITY = 10.0
BUFFER = 75.0


def files(columns, rows, side=250.0, origin=(13.0, 7.0)):
    """Return the bounds of square files side by side."""
    x, y = origin
    return [
        Rectangle(x + i * side, y + k * side, x + (i + 1) * side, y + (k + 1) * side)
        for i in range(columns)
        for k in range(rows)
    ]


def chosen(areas, most, density=DENSITY):
    counts = [round(density * (a.x_max - a.x_min) * (a.y_max - a.y_min)) for a in areas]
    return fitting_tiles(bounds_of(areas), np.array(counts, dtype=np.float64), BUFFER, most)


def points_of_tiles(areas, size, start):
    """Count the points of each tile with its buffer on a grid of points in all files, one per 5 m by 5 m."""
    west, south, east, north = (share * BUFFER for share in BUFFER_SHARES)
    steps = [
        np.stack(np.meshgrid(*(np.arange(low + 2.5, high, 5.0) for low, high in spans)), -1)
        for spans in (((a.x_min, a.x_max), (a.y_min, a.y_max)) for a in areas)
    ]
    xy = np.concatenate([one.reshape(-1, 2) for one in steps]) - start
    tiles = np.unique(np.floor(xy / size), axis=0)
    return [
        25.0
        * DENSITY
        * np.count_nonzero(
            (xy >= (x * size - west, y * size - south)).all(axis=1)
            & (xy <= ((x + 1) * size + east, (y + 1) * size + north)).all(axis=1)
        )
        for x, y in tiles
    ]


SURVEYS = {"square": files(4, 4), "row": files(7, 2), "two": files(3, 3) + files(2, 2, origin=(3013.0, 7.0))}


@cache
def points_by_tiles(survey):
    return {
        (float(size), start): points_of_tiles(SURVEYS[survey], size, start)
        for size in range(200, 1001, 25)
        for start in (0.0, 0.5 * size)
    }


@pytest.mark.parametrize("survey", SURVEYS)
@pytest.mark.parametrize("most", [1_000_000, 2_500_000, 4_000_000])
def test_no_tiles_that_fit_let_points_be_seen_less_often(survey, most):
    seen, tiles = points_by_tiles(survey), chosen(SURVEYS[survey], most)[:2]
    assert max(seen[tiles]) <= 1.02 * most  # grid against area
    assert sum(seen[tiles]) <= 1.02 * min(
        sum(points) for points in seen.values() if max(points) <= 0.98 * most
    )


def test_bounds_that_cannot_be_true_do_not_count():
    survey = files(4, 4)
    broken = Rectangle(-1e12, -1e12, 1e12, 1e12)
    assert chosen([*survey, broken], 2_500_000) == chosen(survey, 2_500_000)
    assert chosen([broken], 2_500_000) == (1000.0, 0.0, BUFFER)


def test_a_survey_of_one_point_is_one_tile():
    assert chosen([Rectangle(5.0, 5.0, 5.0, 5.0)], 2_500_000) == (1000.0, 0.0, BUFFER)
    assert chosen([], 2_500_000) == (1000.0, 0.0, BUFFER)


def test_what_lies_around_the_origin_is_one_tile():
    assert chosen([Rectangle(-70.0, -80.0, 65.0, 80.0)], 2_500_000) == (1000.0, 500.0, BUFFER)
    assert chosen([Rectangle(0.0, 0.0, 999.0, 999.0)], 12_500_000) == (1000.0, 0.0, BUFFER)


@pytest.mark.parametrize(("density", "buffer"), [(1.0, 75.0), (15.0, 75.0), (60.0, 37.5), (400.0, 37.5)])
def test_where_points_are_dense_the_buffer_is_narrow(density, buffer):
    areas = files(4, 4)
    counts = np.full(len(areas), density * 250.0**2)
    cut = tiles_for(TilingConfig(), bounds_of(areas), counts)
    assert cut.buffer == buffer
    seen = expected_points(bounds_of(areas) - cut.start, counts, cut.buffer, cut.size)
    assert seen.max() < TilingConfig().max_tile_points or cut.size == 50.0


@pytest.mark.parametrize("buffer", [40.0, 75.0])
def test_tiles_of_a_size_that_is_asked_for_have_the_buffer_that_is_asked_for(buffer):
    config = TilingConfig(tile_size=60.0, buffer=buffer)
    assert tiles_for(config, bounds_of(files(2, 2)), np.full(4, 1e8)) == (60.0, 0.0, buffer)
