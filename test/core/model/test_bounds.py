"""What can be held, and what is said of the rest."""

import numpy as np
import pytest

from lidar_buildings.core.model import bounds
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.segmentation.segmentation import segment_buildings


@pytest.mark.parametrize(
    ("stray", "is_kept"),
    [
        ((0.0, 1.88e30, 0.0), False),
        ((np.nan, 0.0, 0.0), False),
        ((0.0, 0.0, -2e5), False),
        ((9000.0, 0.0, 0.0), False),
        ((0.0, -2000.0, 5e4), True),
    ],
)
def test_points_beyond_are_told_from_those_of_a_tile(stray, is_kept):
    points = np.vstack([np.zeros((9, 3)), [stray]])
    assert bounds.are_of_tile(points).tolist() == [True] * 9 + [is_kept]


def test_a_wide_tile_far_from_the_origin_is_whole():
    points = np.column_stack([np.linspace(3e5, 3.05e5, 50), np.zeros(50), np.zeros(50)])
    assert bounds.are_of_tile(points).all()


def test_values_beyond_their_column_become_its_nearest_and_nan_stays():
    values = np.array([1e38, -5.0, np.nan, 2.0], dtype=np.float32)
    np.testing.assert_array_equal(
        bounds.held_column("neighbourhood_radius", values), np.float32([1e4, 0.0, np.nan, 2.0])
    )


@pytest.mark.parametrize(
    "members", [{"point_spacing": 1e-300}, {"point_spacing": 1e9}, {"dark_limit": 1e300}]
)
def test_a_tile_has_no_spacing_or_limit_that_cannot_be(members):
    with pytest.raises(ValueError, match=f"{next(iter(members))} = .*: must be"):
        PointTile(np.zeros((1, 3)), **members)


def test_a_stage_refuses_coordinates_that_are_nowhere_on_earth():
    with pytest.raises(ValueError, match=r"points\[1\] = .*must be finite, and within 1e\+08 m"):
        segment_buildings(np.array([[0.0, 0, 0], [0, 1.88e30, 0]]))
