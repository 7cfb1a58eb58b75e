import numpy as np
import shapely

from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.core.stages.regularisation.regularising import RegularisedOutline
from lidar_buildings.pipeline.tile_outlines import regularise_outlines, touching_groups


def ring_of(box, step=0.6):
    """The ring of a rectangle as if traced at a spacing of half the step: points along it."""
    segments = shapely.segmentize(shapely.orient_polygons(box), step)
    return Outline(shapely.get_coordinates(segments.exterior)[:-1])


def polygons(outlines):
    return np.array([shapely.Polygon(one.exterior, one.holes) for one in outlines], dtype=object)


def test_houses_whose_rings_are_a_spacing_apart_are_of_one_block_and_others_are_not():
    boxes = [shapely.box(0, 0, 10, 8), shapely.box(10.5, 0, 20, 8), shapely.box(30, 0, 40, 8)]
    assert touching_groups([ring_of(box) for box in boxes]) == [[0, 1]]
    assert touching_groups([ring_of(box, 0.3) for box in boxes]) == []
    assert touching_groups([ring_of(boxes[1]), ring_of(boxes[2]), ring_of(boxes[0])]) == [[0, 2]]


def test_the_stage_shares_walls_unless_told_otherwise():
    boxes = [shapely.box(0, 0, 12, 8), shapely.box(12.5, 1, 24, 9)]
    traced = tuple(BuildingOutline(k + 1, ring_of(box)) for k, box in enumerate(boxes))
    shared = polygons(one.outline for one in regularise_outlines(traced, RegularisationConfig()))
    assert shapely.coverage_is_valid(shared)
    assert shapely.length(shapely.intersection(*shared)) > 6.5
    alone = RegularisationConfig(max_wall_gap=0.0)
    apart = polygons(one.outline for one in regularise_outlines(traced, alone))
    assert shapely.distance(*apart) > 0.3
    assert [one.building_id for one in regularise_outlines(traced, alone)] == [1, 2]


def regularised(outline):
    return RegularisedOutline(outline, 0.1, 0.2, (), BuildingStatus.OK, "")


def test_an_outline_that_rounding_would_spoil_stays_as_traced(monkeypatch):
    traced = ring_of(shapely.box(0, 0, 12, 8))
    sliver = np.array([(0, 0), (12, 0), (12, 8), (6, 1e-12), (0, 8)])
    assert Outline(sliver).polygon.is_valid
    far = 1e6
    moved = BuildingOutline(1, Outline(traced.exterior + far))
    spoilt = regularised(Outline(sliver + far))
    monkeypatch.setattr("lidar_buildings.pipeline.tile_outlines.regularise_outline", lambda *_: spoilt)
    (result,) = regularise_outlines((moved,), RegularisationConfig())
    assert result.outline.polygon.is_valid
    assert len(result.outline.exterior) == len(traced.exterior)
    assert result.quality.status is BuildingStatus.TRACED_OUTLINE


def test_walls_that_would_lie_over_a_neighbour_end_where_it_has_its_points(monkeypatch):
    large, small = ring_of(shapely.box(0, 0, 20, 10)), ring_of(shapely.box(20.5, 2, 26.5, 8))
    grown = {
        len(large.exterior): shapely.box(0, 0, 23, 10),
        len(small.exterior): shapely.box(20.5, 2, 26.5, 8),
    }

    def grow(traced, _):
        box = shapely.orient_polygons(grown[len(traced.exterior)])
        return regularised(Outline(shapely.get_coordinates(box.exterior)[:-1]))

    monkeypatch.setattr("lidar_buildings.pipeline.tile_outlines.regularise_outline", grow)
    given = tuple(BuildingOutline(k + 1, one) for k, one in enumerate((large, small)))
    alone = RegularisationConfig(max_wall_gap=0.0)
    result = polygons(one.outline for one in regularise_outlines(given, alone))
    assert result[0].intersection(result[1]).area == 0.0
    assert result[0].equals(shapely.difference(shapely.box(0, 0, 23, 10), result[1]))
    assert result[1].equals(shapely.box(20.5, 2, 26.5, 8))


def test_overlapping_walls_that_cannot_be_cut_leave_both_as_traced(monkeypatch):
    long, wide = ring_of(shapely.box(0, 4, 20, 6)), ring_of(shapely.box(4, 6.4, 12, 19))
    grown = {len(long.exterior): shapely.box(0, 4, 20, 6), len(wide.exterior): shapely.box(4, -9, 12, 19)}

    def grow(traced, _):
        box = shapely.orient_polygons(grown[len(traced.exterior)])
        return regularised(Outline(shapely.get_coordinates(box.exterior)[:-1]))

    monkeypatch.setattr("lidar_buildings.pipeline.tile_outlines.regularise_outline", grow)
    given = tuple(BuildingOutline(k + 1, one) for k, one in enumerate((long, wide)))
    results = regularise_outlines(given, RegularisationConfig(max_wall_gap=0.0))
    found = polygons(one.outline for one in results)
    assert found[0].intersection(found[1]).area == 0.0
    assert BuildingStatus.TRACED_OUTLINE in [one.quality.status for one in results]


def test_a_block_whose_walls_cannot_be_shared_costs_no_other_building(monkeypatch, caplog):
    def broken(outlines, *_):
        raise shapely.GEOSException("TopologyException: made to fail")

    boxes = [shapely.box(0, 0, 12, 8), shapely.box(12.5, 1, 24, 9), shapely.box(40, 0, 52, 8)]
    traced = tuple(BuildingOutline(k + 1, ring_of(box)) for k, box in enumerate(boxes))
    monkeypatch.setattr("lidar_buildings.pipeline.tile_outlines.share_walls", broken)
    results = regularise_outlines(traced, RegularisationConfig())
    found = polygons(one.outline for one in results)
    assert shapely.is_valid(found).all()
    assert (shapely.area(shapely.intersection(found, boxes)) > 0.9 * shapely.area(boxes)).all()
    assert "its 2 buildings share no walls" in caplog.text
