"""Points of class 12: used where nothing else covers the place. And clouds of roofs alone."""

import numpy as np
import pytest

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.ground_filter.classification import used_classes
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.pipeline.tile_stages import filter_ground


@pytest.fixture(scope="module")
def strips():
    """Two strips of a metre's spacing: class 1 to x = 30, class 12 from x = 20 on; some noise beyond."""
    x, y = (one.ravel() for one in np.meshgrid(np.arange(31.0), np.arange(20.0)))
    one, other = np.column_stack([x, y, 0 * x]), np.column_stack([x + 20.4, y + 0.4, 0 * x])
    noise = one[::7] + np.array([31.0, 0.2, 0.0])
    classes = np.repeat([1, 12, 7], [len(one), len(other), len(noise)]).astype(np.uint8)
    return np.vstack([one, other, noise]), classes


def test_overlap_is_used_where_nothing_else_covers_the_place(strips):
    points, classes = strips
    found = used_classes(points, classes, 1.0)
    is_overlap, x = classes == 12, points[:, 0]
    assert (found[~is_overlap] == classes[~is_overlap]).all()
    assert (found[is_overlap & (x > 31.0)] == 0).all()
    assert (found[is_overlap & (x < 29.0)] == 12).all()
    order = np.random.default_rng(0).permutation(len(points))
    np.testing.assert_array_equal(used_classes(points[order], classes[order], 1.0), found[order])
    assert (used_classes(points[is_overlap], classes[is_overlap], 1.0) == 0).all()


def test_the_stage_finds_ground_there_and_keeps_the_class_elsewhere(strips):
    points, classes = strips
    tile = filter_ground(
        PointTile(points, classification=classes, point_spacing=1.0), GroundFilterConfig()
    ).tile
    is_overlap, x = classes == 12, points[:, 0]
    assert (tile.classification[is_overlap & (x > 31.0)] == 2).all()
    assert (tile.classification[is_overlap & (x < 29.0)] == 12).all()


def test_without_ground_every_point_stands_a_storey_high(strips):
    points, _ = strips
    tile = filter_ground(PointTile(points, point_spacing=1.0), GroundFilterConfig(method="none")).tile
    assert set(tile.classification.tolist()) == {1}
    assert (tile.height_above_ground == 3.0).all()
