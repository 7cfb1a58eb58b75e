import laspy
import numpy as np
import pytest
from support.cut_surveys import tiles_of

from lidar_buildings.core.neighbours.point_spacing import FINEST, steady_spacing
from lidar_buildings.io.clouds.point_columns import last_returns
from lidar_buildings.io.tiling.survey_spacing import expected_spacing
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig
from lidar_buildings.simulation import simulate_survey


def lattice(spacing: float, side: float = 30.0) -> np.ndarray:
    x, y = np.meshgrid(np.arange(0.0, side, spacing), np.arange(0.0, side, spacing))
    return np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))


def test_a_pulse_counts_once_however_many_returns_it_has():
    points = np.repeat(lattice(0.5), 2, axis=0)
    return_number = np.tile([1, 2], len(points) // 2).astype(np.uint8)
    number_of_returns = np.full(len(points), 2, dtype=np.uint8)
    np.testing.assert_array_equal(last_returns(points, return_number, number_of_returns), points[1::2])


def test_without_return_numbers_every_point_is_a_pulse():
    assert len(last_returns(lattice(1.0), None, None)) == 900


def test_few_points_tell_nothing_of_the_survey():
    assert expected_spacing([]) is None
    assert expected_spacing([lattice(1.0)[:999]]) is None
    assert expected_spacing([lattice(0.5)[:1800], lattice(0.5)[1800:]]) == pytest.approx(0.5, rel=0.05)


def test_a_tile_takes_the_expected_spacing_unless_its_own_is_quite_another():
    assert steady_spacing(lattice(0.5), 0.45) == 0.45
    assert steady_spacing(lattice(0.5), 2.0) == pytest.approx(0.5, rel=0.2)


def test_what_is_finer_than_any_detail_of_a_building_counts_as_no_finer():
    assert [steady_spacing(lattice(0.02, 5.0), one) for one in (None, 0.02, 2.0)] == [FINEST] * 3


def test_all_tiles_of_a_survey_have_one_spacing_whatever_their_size(tmp_path):
    simulate_survey(tmp_path, "village", density=2.0)
    found = set()
    for tile_size in (70.0, 200.0):
        with TileSource(tmp_path, TilingConfig(tile_size=tile_size)) as source:
            found |= {tile.point_spacing for tile in tiles_of(source)}
    assert len(found) == 1


def test_a_survey_in_one_file_has_the_spacing_that_it_has_in_many(tmp_path):
    simulate_survey(tmp_path / "strips", "village", density=2.0)
    strips = [laspy.read(path) for path in sorted((tmp_path / "strips").glob("*.laz"))]
    assert len(strips) > 1
    whole = laspy.LasData(strips[0].header)
    records = np.concatenate([strip.points.array for strip in strips])
    whole.points = laspy.ScaleAwarePointRecord(
        records, strips[0].point_format, strips[0].header.scales, strips[0].header.offsets
    )
    whole.write(tmp_path / "whole.laz")
    found = []
    for path in (tmp_path / "strips", tmp_path / "whole.laz"):
        with TileSource(path, TilingConfig(tile_size=100.0)) as source:
            found.append({tile.point_spacing for tile in tiles_of(source)})
    assert found[0] == found[1]
    assert len(found[0]) == 1
