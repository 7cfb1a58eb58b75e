"""The roofs that matter to a tile: what hangs together with its core, and nothing else changes a result."""

import numpy as np
import pytest
import shapely

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.edge_labelling.config import EdgeLabellingConfig
from lidar_buildings.core.stages.footprints.config import FootprintConfig
from lidar_buildings.core.stages.footprints.footprints import footprints_of
from lidar_buildings.core.surfaces.surface_patches import APART_SPACINGS, own_roofs
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.tile_stages import fit_planes, label_roof_edges, roof_points
from lidar_buildings.pipeline.tile_tracing import trace_buildings, trace_footprints

SPACING = 0.5


def roof(west, size=10.0):
    """Points of a flat roof on a lattice with some noise, south-western corner at (west, 0)."""
    x, y = np.meshgrid(np.arange(0.0, size, SPACING), np.arange(0.0, size, SPACING))
    points = np.column_stack([x.ravel() + west, y.ravel(), np.full(x.size, 6.0)])
    return points + np.random.default_rng(int(west) + 100).normal(0.0, 0.03, points.shape)


@pytest.fixture
def tile():
    """A tile of 20 m with a roof in its core, one across its eastern edge and two beyond it."""
    points = np.vstack([roof(2.0), roof(15.0), roof(25.0 + 0.8 * APART_SPACINGS * SPACING), roof(60.0)])
    return PointTile(
        points,
        classification=np.full(len(points), 6, dtype=np.uint8),
        facade=(np.arange(len(points)) % 50 == 0).astype(np.uint8),
        buffer=(points[:, 0] >= 20.0).astype(np.uint8),
        point_spacing=SPACING,
        bounds=(-50.0, -50.0, 95.0, 70.0),
    )


def test_roofs_that_hang_together_with_the_core_are_its_own(tile):
    is_own = own_roofs(tile)
    assert np.array_equal(is_own, tile.is_roof & (tile.points[:, 0] < 55.0))


def test_without_a_buffer_or_a_spacing_all_roofs_are(tile):
    for other in (tile.with_columns(buffer=None), tile.with_columns(point_spacing=None)):
        assert np.array_equal(own_roofs(other), tile.is_roof)


def test_what_is_left_out_changes_nothing_that_the_tile_says(tile):
    config = PipelineConfig()
    found = []
    for roofs in (tile.select(tile.is_roof), roof_points(tile)):
        labelled = label_roof_edges(roofs, config.edge_labelling).tile
        traced = trace_buildings(labelled, config.segmentation, config.boundary_tracing)
        found.append((fit_planes(traced.tile, config.plane_fitting), traced.outlines))
    (every, outlines), (own, own_outlines) = found
    assert 0 < len(own) < len(every)
    kept = every.select(every.points[:, 0] < 55.0)
    assert all(np.array_equal(column, own.columns[name]) for name, column in kept.columns.items())
    assert [one.building_id for one in own_outlines] == [one.building_id for one in outlines]
    for one, other in zip(outlines, own_outlines, strict=True):
        assert np.array_equal(one.outline.exterior, other.outline.exterior)
    assert len(outlines) == 2


def test_a_footprint_has_the_roofs_that_hang_together_with_nothing_in_the_core(tile):
    lawn = np.column_stack([np.arange(18.0, 75.0, 0.5), np.full(114, 12.0), np.zeros(114)])
    points = np.vstack([tile.points, lawn])
    classes = np.where(np.arange(len(points)) < len(tile), 6, 2)
    classified = PointTile(
        points,
        classification=classes,
        facade=np.zeros(len(points)),
        height_above_ground=points[:, 2],
        buffer=points[:, 0] >= 20.0,
        point_spacing=SPACING,
    )
    given = footprints_of([shapely.box(17.0, 11.5, 71.0, 12.5).union(shapely.box(59.0, -1.0, 71.0, 12.0))])
    labelled = label_roof_edges(roof_points(classified), EdgeLabellingConfig()).tile
    traced = trace_footprints(classified, labelled, given, FootprintConfig(), EdgeLabellingConfig())
    inside = traced.tile.points[traced.tile.building_id > 0]
    assert np.count_nonzero(inside[:, 0] > 59.0) == np.count_nonzero(tile.points[:, 0] > 59.0)
    assert traced.tile.edge[traced.tile.building_id > 0].any()
