import numpy as np
import pytest

from lidar_buildings.core.point_spacing import steady_spacing
from lidar_buildings.io.pulse_spacing import expected_spacing, pulses
from lidar_buildings.io.tiling import TileSource, TilingConfig
from lidar_buildings.simulation import simulate_survey


def lattice(spacing: float, side: float = 30.0) -> np.ndarray:
    x, y = np.meshgrid(np.arange(0.0, side, spacing), np.arange(0.0, side, spacing))
    return np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))


def test_a_pulse_counts_once_however_many_returns_it_has():
    points = np.repeat(lattice(0.5), 2, axis=0)
    return_number = np.tile([1, 2], len(points) // 2).astype(np.uint8)
    number_of_returns = np.full(len(points), 2, dtype=np.uint8)
    np.testing.assert_array_equal(pulses(points, return_number, number_of_returns), points[1::2])


def test_without_return_numbers_every_point_is_a_pulse():
    assert len(pulses(lattice(1.0), None, None)) == 900


def test_few_points_tell_nothing_of_the_survey():
    assert expected_spacing([]) is None
    assert expected_spacing([lattice(1.0)[:999]]) is None
    assert expected_spacing([lattice(0.5)[:1800], lattice(0.5)[1800:]]) == pytest.approx(0.5, rel=0.05)


def test_a_tile_takes_the_expected_spacing_unless_its_own_is_quite_another():
    assert steady_spacing(lattice(0.5), 0.45) == 0.45
    assert steady_spacing(lattice(0.5), 2.0) == pytest.approx(0.5, rel=0.2)


def test_all_tiles_of_a_survey_have_one_spacing_whatever_their_size(tmp_path):
    simulate_survey(tmp_path, "village", density=2.0)
    found = set()
    for tile_size in (70.0, 200.0):
        with TileSource(tmp_path, TilingConfig(tile_size=tile_size)) as source:
            found |= {tile.spacing for tile in source}
    assert len(found) == 1
