"""A tile's buildings of which walls were seen: what goes on, who owns them, what is built of them."""

import numpy as np
import pytest
import shapely

from lidar_buildings.core.model.classes import FacadeClass, PointClass
from lidar_buildings.core.model.sides import Sides
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.reconstruct import reconstruct_tile
from lidar_buildings.pipeline.tile_models import build_models
from lidar_buildings.pipeline.tile_outlines import regularise_outlines
from lidar_buildings.pipeline.tile_stages import fit_planes, label_roof_edges, roof_points
from lidar_buildings.pipeline.tile_tracing import trace_or_close
from lidar_buildings.pipeline.tile_walls import walled_buildings

CONFIG = PipelineConfig()
HOUSE = shapely.box(2.0, 3.0, 14.0, 11.0)
EAVES, GROUND = 6.0, 1.0


def street_scene(seed=0, east=20.0):
    """Ground before a house of which the west and south walls were seen, and another one from above."""
    random = np.random.default_rng(seed)
    xy = random.uniform((-10.0, -10.0), (east, 11.0), (12_000, 2))
    xy = xy[~shapely.contains_xy(HOUSE, xy)]
    ground = np.column_stack([xy, np.full(len(xy), GROUND)])
    south = np.column_stack([random.uniform(2.0, 14.0, 6000), np.full(6000, 3.0)])
    west = np.column_stack([np.full(4000, 2.0), random.uniform(3.0, 11.0, 4000)])
    walls = np.concatenate([south, west])
    walls = np.column_stack([walls, random.uniform(GROUND + 1.0, EAVES, len(walls))])
    x, y = np.meshgrid(np.arange(40.0, 50.0, 0.3), np.arange(0.0, 8.0, 0.3))
    roof = np.column_stack([x.ravel(), y.ravel(), 5.0 + 0.5 * x.ravel() - 20.0])
    points = np.concatenate([ground, walls, roof]) + random.normal(
        0.0, 0.01, (len(ground) + 10_000 + x.size, 3)
    )
    n = [len(ground), len(walls), len(roof)]
    return PointTile(
        points=points,
        classification=np.repeat([PointClass.GROUND, PointClass.BUILDING, PointClass.BUILDING], n),
        facade=np.repeat([FacadeClass.NONE, FacadeClass.BARE, FacadeClass.NONE], n),
        height_above_ground=points[:, 2] - GROUND,
        point_spacing=0.3,
    )


def traced(tile):
    labelled = label_roof_edges(roof_points(tile), CONFIG.edge_labelling).tile
    return trace_or_close(labelled, CONFIG.segmentation, CONFIG.boundary_tracing)


def test_a_house_seen_from_the_street_gets_its_outline_and_one_height():
    found = traced(street_scene())
    assert len(found.outlines) == 2
    outlines = regularise_outlines(found.outlines, CONFIG.regularisation)
    models = build_models(fit_planes(found.tile, CONFIG.plane_fitting), outlines, CONFIG.building_model)
    [house] = [one for one in models if one.anchor[0] < 30.0]
    [other] = [one for one in models if one.anchor[0] > 30.0]
    [outline] = [one for one in outlines if one.building_id == house.building_id]
    assert outline.outline.polygon.intersection(HOUSE).area / outline.outline.polygon.union(HOUSE).area > 0.97
    assert set(house.model.solids) == {"1.2"}
    assert house.attributes["status"] == BuildingStatus.OK.value
    assert "roof was not seen whole" in house.attributes["reason"]
    assert house.attributes["height"] == pytest.approx(EAVES - GROUND, abs=0.3)
    assert house.attributes["roof_type"] == "unknown"
    assert set(other.model.solids) == {"1.2", "1.3", "2.2"}
    assert other.attributes["reason"] == ""


def test_what_goes_on_tells_the_same_as_all_points():
    tile = street_scene()
    part = roof_points(tile)
    assert len(part) < 0.7 * len(tile)
    found, every = walled_buildings(part, 12.0)[0], walled_buildings(tile, 12.0)[0]
    for (rows, outline), (all_rows, same) in zip(found, every, strict=True):
        assert outline.same_as(same)
        np.testing.assert_array_equal(part.points[rows], tile.points[all_rows])
    assert len(every) == 1
    assert not walled_buildings(tile, 1000.0)[0]


def sparse_yard(spacing):
    """A block round a court of 8 m, seen from above, and ground all about it."""
    x, y = np.meshgrid(np.arange(-40.0, 80.0, spacing), np.arange(-40.0, 80.0, spacing))
    xy = np.column_stack([x.ravel(), y.ravel()]) + np.random.default_rng(3).uniform(-0.1, 0.1, (x.size, 2))
    block = shapely.box(0.0, 0.0, 24.0, 28.0) - shapely.box(8.0, 8.0, 16.0, 20.0)
    is_roof = shapely.contains_xy(block, *xy.T)
    return PointTile(
        points=np.column_stack([xy, np.where(is_roof, 8.0, 0.0)]),
        classification=np.where(is_roof, PointClass.BUILDING, PointClass.GROUND).astype(np.uint8),
        height_above_ground=np.where(is_roof, 8.0, 0.0),
        point_spacing=spacing,
    )


def test_ground_about_sparse_roofs_goes_on_and_opens_courts():
    tile = sparse_yard(1.8)
    part = roof_points(tile)
    assert np.count_nonzero(part.is_roof) == np.count_nonzero(tile.is_roof)
    assert not part.is_roof.all()
    assert len(part) < 0.7 * len(tile), "ground far from roofs stays behind"
    found = traced(tile)
    [outline] = found.outlines
    assert len(outline.outline.holes) == 1
    assert found.tile.is_roof.all()
    assert (found.tile.building_id > 0).all()
    [blind] = trace_or_close(
        label_roof_edges(tile.select(tile.is_roof), CONFIG.edge_labelling).tile,
        CONFIG.segmentation,
        CONFIG.boundary_tracing,
    ).outlines
    assert not blind.outline.holes


def test_ground_goes_on_where_a_courtyard_may_be_narrower_than_the_disc_that_tells_it():
    assert not roof_points(sparse_yard(0.45)).is_roof.all()
    assert roof_points(sparse_yard(0.35)).is_roof.all()


@pytest.mark.parametrize(("core", "is_own"), [((-20.0, 8.0), True), ((8.0, 60.0), False)])
def test_a_building_belongs_to_the_tile_with_its_anchor(core, is_own):
    tile = street_scene()
    is_core = (tile.points[:, 0] >= core[0]) & (tile.points[:, 0] < core[1])
    found = traced(tile.with_columns(buffer=(~is_core).astype(np.uint8)))
    houses = [one for one in found.outlines if one.outline.exterior[:, 0].max() < 30.0]
    assert len(houses) == is_own
    walls = found.tile.points[found.tile.facade == FacadeClass.BARE]
    assert (len(walls) > 100) == is_own
    assert not is_own or np.mean(walls[:, 2] > EAVES - 0.7) > 0.99, "tops of walls alone"


def test_one_that_passes_the_tiles_limits_asks_for_more():
    tile = street_scene()
    for east, sides in ((13.5, Sides(east=True)), (60.0, Sides())):
        cut = tile.select(tile.points[:, 0] < east).with_columns(bounds=(-30.0, -30.0, east, 60.0))
        assert traced(cut).clipped == sides


def test_the_chain_without_ros_closes_it_too():
    tile = street_scene().with_columns(facade=None, classification=None, height_above_ground=None)
    result = reconstruct_tile(tile.select(tile.points[:, 0] < 30.0), CONFIG)
    [outline] = result.outlines
    assert outline.outline.polygon.intersection(HOUSE).area / HOUSE.area > 0.97
    assert result.models[0].attributes["lod"] == "1.2"


def test_a_house_that_a_wall_joins_to_one_that_is_closed_stays_what_it_is():
    tile, random = street_scene(), np.random.default_rng(3)
    x, z = random.uniform(14.0, 40.0, 6000), random.uniform(GROUND, EAVES, 6000)
    between = PointTile(
        points=np.column_stack([x, np.full(6000, 5.0), z]),
        classification=np.full(6000, PointClass.BUILDING),
        facade=np.full(6000, FacadeClass.BARE),
        height_above_ground=z - GROUND,
    )
    joined = traced(tile.joined(between))
    alone = traced(tile)
    assert [one.building_id for one in joined.outlines] == [one.building_id for one in alone.outlines]
    outlines = regularise_outlines(joined.outlines, CONFIG.regularisation)
    models = build_models(fit_planes(joined.tile, CONFIG.plane_fitting), outlines, CONFIG.building_model)
    assert sorted(max(one.model.solids) for one in models) == ["1.2", "2.2"]
    for before, after in zip(alone.outlines, joined.outlines, strict=True):
        assert after.outline.area == pytest.approx(before.outline.area, rel=0.02)
