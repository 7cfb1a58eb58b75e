"""The models of a tile: every outline gets one, whatever happens to the others."""

import numpy as np
import pytest

from lidar_buildings.core.model.outline import BuildingOutline, Outline, OutlineQuality
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.building_model.config import DRAPED, BuildingModelConfig
from lidar_buildings.core.stages.building_model.result import ATTRIBUTES
from lidar_buildings.pipeline import tile_models

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])


def house(number, n_points=300):
    random = np.random.default_rng(number)
    points = np.column_stack([random.uniform(0, 10, (n_points, 2)), random.normal(6.0, 0.02, n_points)])
    return points + np.array([20.0 * number, 0.0, 0.0])


@pytest.fixture
def tile():
    """Three flat houses in a row, of which the third has no points."""
    points = np.concatenate([house(1), house(2)])
    return PointTile(
        points,
        height_above_ground=points[:, 2] - 1.0,
        building_id=np.repeat([1, 2], 300).astype(np.uint32),
        plane_id=np.ones(600, dtype=np.uint16),
    )


def models(tile):
    outlines = tuple(BuildingOutline(k, Outline(SQUARE + np.array([20.0 * k, 0.0]))) for k in (3, 1, 2))
    return tile_models.build_models(tile, outlines, BuildingModelConfig())


def test_models_come_by_rising_id_and_one_without_points_says_so(tile):
    first, second, empty = models(tile)
    assert [one.building_id for one in (first, second, empty)] == [1, 2, 3]
    assert [one.attributes["lod"] for one in (first, second, empty)] == ["2.2", "2.2", ""]
    assert first.attributes["ground_elevation"] == pytest.approx(1.0)
    assert "no roof points" in empty.attributes["reason"]


def test_a_building_that_fails_says_why_and_does_not_touch_the_others(tile, monkeypatch):
    build = tile_models.build_model

    def fail_at_the_second(points, *arguments, **named):
        if len(points) and points[:, 0].min() > 35.0:
            raise RuntimeError("a beam broke")
        return build(points, *arguments, **named)

    expected = models(tile)
    monkeypatch.setattr(tile_models, "build_model", fail_at_the_second)
    first, second, empty = models(tile)
    assert second.attributes["status"] == "failed"
    assert "a beam broke" in second.attributes["reason"]
    assert second.model.solids == {}
    assert set(ATTRIBUTES) <= set(second.attributes)
    assert first.attributes == expected[0].attributes
    assert empty.attributes == expected[2].attributes


def test_what_was_done_about_an_outline_is_told_of_a_building_that_is_ok(tile):
    ring = Outline(SQUARE + np.array([20.0, 0.0]))
    known = OutlineQuality(0.1, 0.2, BuildingStatus.OK, "a courtyard was left out")
    outlines = (BuildingOutline(1, ring, quality=known),)
    (one,) = tile_models.build_models(tile, outlines, BuildingModelConfig())
    assert (one.attributes["status"], one.attributes["reason"]) == ("ok", "a courtyard was left out")


def test_rings_without_vertices_do_not_touch_the_others(tile):
    nothing = Outline(np.empty((0, 2)))
    west, east = (Outline(SQUARE + np.array([20.0 * k, 0.0])) for k in (1, 2))
    measured = OutlineQuality(0.1, 0.2, BuildingStatus.OK, "")
    failed = OutlineQuality(np.nan, np.nan, BuildingStatus.FAILED, "unexpected error: a ruler broke")
    outlines = (
        BuildingOutline(1, west, quality=measured),
        BuildingOutline(2, east, quality=failed),
        BuildingOutline(4, nothing),
    )
    first, second, empty = tile_models.build_models(tile, outlines, BuildingModelConfig())
    assert [one.attributes["lod"] for one in (first, second, empty)] == ["2.2", "2.2", ""]
    assert (first.attributes["outline_sigma"], first.attributes["outline_max_offset"]) == (0.1, 0.2)
    assert "outline_sigma" not in empty.attributes
    assert second.attributes["status"] == "failed"
    assert "unexpected error" in second.attributes["reason"]
    assert empty.attributes["status"] == "degenerate"


def test_neighbours_on_the_terrain_meet_in_one_foot_and_tell_how_high_it_lies():
    """Two houses wall to wall across a hillside that bends."""
    random = np.random.default_rng(0)
    xy = random.uniform((20, 0), (40, 10), (900, 2))
    ground = 0.2 * xy[:, 0] + np.sin(xy[:, 1])
    both = PointTile(
        np.column_stack([xy, random.normal(18.0, 0.02, 900)]),
        height_above_ground=18.0 - ground,
        building_id=np.where(xy[:, 0] < 30, 1, 2),
        plane_id=np.ones(900),
    )
    outlines = tuple(BuildingOutline(k, Outline(SQUARE + np.array([10.0 + 10.0 * k, 0.0]))) for k in (1, 2))
    west, east = tile_models.build_models(both, outlines, BuildingModelConfig(foot=DRAPED))
    walls = []
    for one in (west, east):
        vertices = one.model.solids["1.2"].vertices
        walls.append({tuple(vertex) for vertex in vertices[vertices[:, 0] == 30.0] if vertex[2] < 12.0})
    assert walls[0] == walls[1]
    assert len(walls[0]) > 3
    assert west.attributes["ground_elevation_min"] == pytest.approx(ground[xy[:, 0] < 30].min(), abs=0.1)
    assert east.attributes["ground_elevation_max"] == pytest.approx(ground.max(), abs=0.1)


def test_a_ring_without_vertices_has_no_foot(tile):
    outlines = (BuildingOutline(1, Outline(np.empty((0, 2)))), BuildingOutline(9, Outline(np.empty((0, 2)))))
    found = tile_models.build_models(tile, outlines, BuildingModelConfig(foot=DRAPED))
    assert [one.attributes["lod"] for one in found] == ["", ""]
