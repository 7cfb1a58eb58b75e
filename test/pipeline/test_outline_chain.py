"""
From roof points to outlines, the three stages together, on what real clouds hold that no book shows.

Whatever comes in, every building gets one valid polygon, no point is lost, and where straight walls are not
to be had the outline is the traced one and says why.
"""

import numpy as np
import pytest
import shapely

from lidar_buildings.core.model.outline import signed_area
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.core.stages.segmentation.config import SegmentationConfig
from lidar_buildings.pipeline.tile_outlines import regularise_outlines
from lidar_buildings.pipeline.tile_tracing import trace_buildings

SPACING = 0.35
#: Every cluster is a building, however small.
KEEP_ALL = SegmentationConfig(min_points=1, min_area=0.0)


def roof(west, south, east, north, spacing=SPACING, seed=0):
    """Points on a rectangle, not quite on a lattice."""
    rng = np.random.default_rng(seed)
    xy = np.stack(np.meshgrid(np.arange(west, east, spacing), np.arange(south, north, spacing)), axis=-1)
    xy = xy.reshape(-1, 2) + rng.uniform(-0.3, 0.3, (xy.size // 2, 2)) * spacing
    return at_height(xy)


def at_height(xy):
    return np.column_stack((xy, np.full(len(xy), 6.0)))


def without(points, west, south, east, north):
    inside = (points[:, 0] > west) & (points[:, 0] < east) & (points[:, 1] > south) & (points[:, 1] < north)
    return points[~inside]


def polygon(outline):
    return shapely.Polygon(outline.exterior, outline.holes)


def outlines_of(points, segmentation=None, spacing=SPACING):
    """Run the three stages, check what must hold of every result, and return the tile and its polygons."""
    tile = PointTile(points=points, point_spacing=spacing)
    traced = trace_buildings(tile, segmentation or SegmentationConfig(), BoundaryTracingConfig())
    outlines = regularise_outlines(traced.outlines, RegularisationConfig())
    assert [one.building_id for one in outlines] == sorted(set(traced.tile.building_id.tolist()) - {0})
    for before, after in zip(traced.outlines, outlines, strict=True):
        assert_sound(after.outline)
        own = traced.tile.points[traced.tile.building_id == after.building_id, :2]
        # Nothing lost: all points are in the traced outline, as it is carried (millimetres).
        assert shapely.distance(polygon(before.outline), shapely.points(own)).max() < 0.005
        if after.outline.same_as(before.outline):
            assert after.quality.status is BuildingStatus.TRACED_OUTLINE
            assert after.quality.reason
    return traced.tile, [polygon(one.outline) for one in outlines]


def assert_sound(outline):
    shape = polygon(outline)
    assert shape.is_valid, shapely.is_valid_reason(shape)
    assert shape.area > 0.0
    assert signed_area(outline.exterior) > 0.0
    assert all(signed_area(hole) < 0.0 for hole in outline.holes)
    assert all(len(np.unique(ring, axis=0)) == len(ring) for ring in outline.rings)


@pytest.mark.parametrize("n_points", [1, 2, 3])
def test_a_cluster_of_a_few_points_is_covered(n_points):
    points = at_height(np.array([(10.0, 4.0), (10.3, 4.1), (10.1, 4.4)])[:n_points])
    _, found = outlines_of(points, KEEP_ALL)
    assert len(found) == 1
    # By default so few are no building.
    assert outlines_of(points)[1] == []


@pytest.mark.parametrize("seed", range(6))
def test_scattered_points_whose_rings_would_touch_themselves_are_traced_without(seed):
    rng = np.random.default_rng(seed)
    # Clumps on a coarse lattice: rings pass between them by single points, to and fro.
    clumps = rng.permutation(np.stack(np.meshgrid(np.arange(8), np.arange(8)), -1).reshape(-1, 2))[:45]
    xy = np.repeat(clumps * 0.75, 4, axis=0) + rng.choice([-0.1, 0.0, 0.1], (180, 2))
    tile, found = outlines_of(at_height(xy), KEEP_ALL)
    assert (tile.building_id > 0).all()
    assert found


def test_the_order_of_points_changes_nothing():
    points = np.concatenate((l_shaped(), roof(40, 0, 50, 8, seed=3)))
    shuffled = points[np.random.default_rng(0).permutation(len(points))]
    for one, other in zip(outlines_of(points)[1], outlines_of(shuffled)[1], strict=True):
        assert one.equals(other)


def l_shaped():
    return without(roof(0, 0, 24, 18), 10, 8, 30, 30)
