"""Given footprints: repaired, numbered, and the points of each."""

import numpy as np
import pytest
import shapely

from lidar_buildings.core.model.sides import Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.footprints.config import FootprintConfig
from lidar_buildings.core.stages.footprints.footprints import (
    assign_footprints,
    footprints_of,
    last_polygon_around,
    repaired_polygons,
)

HOUSE = shapely.box(10, 10, 20, 18)
NEIGHBOUR = shapely.box(20, 10, 28, 18)
SCRIBBLE = shapely.Polygon(np.random.default_rng(0).uniform(0, 50, (100, 2)))
BOWTIE = shapely.Polygon([(0, 0), (10, 10), (10, 0), (0, 10)])


def array(*geometries):
    found = np.empty(len(geometries), dtype=object)
    found[:] = geometries
    return found


def footprints(*polygons):
    return footprints_of(repaired_polygons(array(*polygons)).polygons)


def town(*houses, step=0.5, side=40.0, **columns):
    """A grid of points: ground at 1 m, and in every house a roof at 6 m of class 6."""
    axis = np.arange(0.25, side, step)
    x, y = (each.ravel() for each in np.meshgrid(axis, axis))
    roof = np.zeros(len(x), dtype=bool)
    for house in houses:
        roof |= shapely.contains_xy(house, x, y)
    given = {
        "classification": np.where(roof, 6, 2),
        "height_above_ground": np.where(roof, 5.0, 0.0),
        "buffer": np.zeros(len(x)),
        **columns,
    }
    return PointTile(np.column_stack([x, y, np.where(roof, 6.0, 1.0)]), **given)


@pytest.mark.parametrize(
    ("given", "n_polygons", "area", "dropped"),
    [
        (HOUSE, 1, 80.0, {}),
        (shapely.force_3d(HOUSE, 7.0), 1, 80.0, {}),
        (BOWTIE, 2, 50.0, {}),
        (shapely.MultiPolygon([HOUSE, shapely.box(30, 30, 31, 31)]), 2, 81.0, {}),
        (shapely.MultiPolygon([HOUSE, NEIGHBOUR]), 2, 144.0, {}),
        (shapely.GeometryCollection([HOUSE, shapely.Point(0, 0)]), 1, 80.0, {}),
        (shapely.Polygon(HOUSE.exterior, [shapely.box(12, 12, 14, 14).exterior]), 1, 76.0, {}),
        (shapely.Polygon([(0, 0), (0, 0), (4, 0), (4, 4), (4, 4.0001), (0, 4)]), 1, 16.0, {}),
        # a spike out and back, and a ring that touches itself in a corner
        (shapely.Polygon([(0, 0), (4, 0), (9, 0), (4, 0), (4, 4), (0, 4)]), 1, 16.0, {}),
        (shapely.Polygon([(0, 0), (4, 0), (4, 4), (8, 4), (8, 8), (4, 8), (4, 4), (0, 4)]), 2, 32.0, {}),
        (None, 0, 0.0, {"empty": 1}),
        (shapely.Polygon(), 0, 0.0, {"empty": 1}),
        (shapely.Point(1, 2), 0, 0.0, {"no polygon": 1}),
        (shapely.LineString([(0, 0), (5, 5)]), 0, 0.0, {"no polygon": 1}),
        (shapely.Polygon([(0, 0), (5, 5), (9, 9)]), 0, 0.0, {"too small or too narrow": 1}),
        (shapely.box(4.36, 52.01, 4.3602, 52.0101), 0, 0.0, {"too small or too narrow": 1}),
        (shapely.box(0, 0, 30, 0.02), 0, 0.0, {"too small or too narrow": 1}),
        (shapely.box(0, 0, np.inf, 3), 0, 0.0, {"with coordinates that cannot be": 1}),
        (SCRIBBLE, 0, 0.0, {"with walls that cross more than 500 times": 1}),
    ],
)
def test_whatever_a_file_calls_a_polygon_becomes_valid_polygons_or_is_counted(
    given, n_polygons, area, dropped
):
    found = repaired_polygons(array(given))
    assert len(found.polygons) == n_polygons
    assert shapely.is_valid(found.polygons).all()
    assert not shapely.has_z(found.polygons).any()
    assert shapely.area(found.polygons).sum() == pytest.approx(area, rel=1e-3)
    assert found.dropped == dropped


def test_a_footprint_that_is_drawn_twice_counts_once_overlapping_ones_both_and_repairs_are_counted():
    again = shapely.Polygon(np.roll(np.array(HOUSE.exterior.coords)[:-1], 1, axis=0)[::-1])
    tower = shapely.box(12, 12, 15, 15)
    found = repaired_polygons(array(HOUSE, again, tower, NEIGHBOUR))
    assert found.row.tolist() == [0, 2, 3]
    assert found.dropped == {"drawn twice": 1}
    assert repaired_polygons(array(HOUSE, BOWTIE, NEIGHBOUR)).n_repaired == 1
    # a few centimetres off, and around the same place others that are larger
    copies = shapely.box(*np.random.default_rng(0).uniform(-0.03, 0.03, (2, 50)), 12.0, 9.0)
    found = repaired_polygons(np.append(copies, shapely.box(-1, -1, 13, 10)))
    assert found.row.tolist() == [0, 50]
    assert found.dropped == {"drawn twice": 49}


def test_no_geometries_tiles_of_one_or_no_point_and_points_without_classes_are_legal():
    found = footprints()
    assert len(found) == 0
    assert assign_footprints(town(HOUSE), found).outlines == ()
    given = footprints(HOUSE)
    assert assign_footprints(PointTile(np.zeros((0, 3))), given).outlines == ()
    found = assign_footprints(PointTile(np.array([[15.0, 14.0, 3.0]])), given)
    assert len(found.outlines) == 1
    assert found.outlines[0].ground_elevation is None
    assert found.building_id.tolist() == given.building_id.tolist()


def test_walls_that_footprints_share_stay_as_they_are():
    jagged = shapely.Polygon([(10, 10), (20.1234, 10.5678), (20.4321, 14.321), (20, 18), (10, 18)])
    beside = shapely.Polygon([(20.1234, 10.5678), (28, 10), (28, 18), (20, 18), (20.4321, 14.321)])
    one, other = (outline.exterior.tolist() for outline in footprints(jagged, beside).outlines)
    assert len([vertex for vertex in one if vertex in other]) == 3
    assert np.abs(np.array(one) - np.array(jagged.exterior.coords)[:-1]).max() < 0.001


def test_footprints_near_a_place_keep_their_ids():
    houses = [shapely.box(20.0 * k, 0.0, 20.0 * k + 10.0, 10.0) for k in range(5)]
    whole = footprints(*houses)
    near = whole.near((25.0, -5.0, 45.0, 5.0))
    assert near.building_id.tolist() == whole.building_id[1:3].tolist()
    assert len(near) == len(near.bounds) == len(near.area) == 2


def test_ids_are_unique_and_do_not_depend_on_the_order_nor_on_the_direction_of_rings():
    polygons = [HOUSE, NEIGHBOUR, shapely.box(12, 12, 15, 15), shapely.box(0, 30, 5, 33)]
    ids = footprints(*polygons).building_id
    assert footprints(*polygons[::-1]).building_id[::-1].tolist() == ids.tolist()
    assert footprints(*(shapely.reverse(one) for one in polygons)).building_id.tolist() == ids.tolist()
    rings = [HOUSE.buffer(-0.4 * k, join_style="mitre") for k in range(8)]
    found = footprints(*rings)
    assert len(set(found.building_id.tolist())) == len(rings)


def test_points_are_told_inside_from_outside_as_shapely_does():
    rng = np.random.default_rng(0)
    star = shapely.Polygon(
        [
            (30 + r * np.cos(a), -5 + r * np.sin(a))
            for a, r in zip(np.linspace(0, 6, 25), rng.uniform(3, 20, 25), strict=True)
        ]
    )
    court = shapely.Polygon(shapely.box(0, 0, 20, 20).exterior, [shapely.box(5, 5, 12, 15).exterior])
    shapes = [star, court, HOUSE]
    xy = rng.uniform(-20, 60, (20_000, 2))
    expected = np.full(len(xy), -1)
    for number, shape in enumerate(shapes):
        expected[shapely.contains_xy(shape, xy)] = number
    assert np.array_equal(last_polygon_around(xy, shapes), expected)


def test_a_footprints_points_are_the_roof_points_within():
    tile = town(HOUSE, NEIGHBOUR)
    given = footprints(HOUSE, NEIGHBOUR)
    found = assign_footprints(tile, given)
    assert [one.building_id for one in found.outlines] == sorted(given.building_id.tolist())
    for polygon, number in zip((HOUSE, NEIGHBOUR), given.building_id, strict=True):
        inside = shapely.contains_xy(polygon, tile.points[:, :2])
        assert np.array_equal(found.building_id == number, inside)
    assert all(one.ground_elevation == 1.0 for one in found.outlines)
    assert not found.clipped


def test_the_ground_within_footprints_is_known():
    tile, wide = town(HOUSE), HOUSE.buffer(2.0)
    found = assign_footprints(tile, footprints(wide))
    inside = shapely.contains_xy(wide, tile.points[:, :2])
    assert found.is_ground.any()
    assert np.array_equal(found.is_ground, inside & (tile.classification == 2))
    assert not found.building_id[found.is_ground].any()


def test_where_footprints_lie_over_each_other_the_smaller_one_has_the_points():
    tower = shapely.box(12, 12, 15, 15)
    tile = town(HOUSE)
    for given in (footprints(HOUSE, tower), footprints(tower, HOUSE)):
        found = assign_footprints(tile, given)
        number = given.building_id[np.argmin(given.area)]
        assert np.array_equal(found.building_id == number, shapely.contains_xy(tower, tile.points[:, :2]))
        assert len(found.outlines) == 2


def test_what_stands_in_a_footprint_without_roof_points_is_taken():
    tile = town(HOUSE)
    hidden = tile.with_columns(classification=np.where(tile.classification == 6, 4, 2))
    given = footprints(HOUSE)
    found = assign_footprints(hidden, given)
    assert np.array_equal(found.building_id > 0, tile.classification == 6)
    low = hidden.with_columns(height_above_ground=0.2 * hidden.height_above_ground)
    assert not assign_footprints(low, given).building_id.any()
    assert assign_footprints(low, given, FootprintConfig(min_height=0.5)).building_id.any()


def test_what_stands_where_a_footprint_has_no_roof_points_completes_it():
    tile = town(HOUSE)
    x = tile.points[:, 0]
    is_house = tile.classification == 6
    for code, facade in ((1, 0), (5, 0), (6, 1)):
        annexe = is_house & (x > 16)
        half = tile.with_columns(
            classification=np.where(annexe, code, tile.classification), facade=np.where(annexe, facade, 0)
        )
        found = assign_footprints(half, footprints(HOUSE))
        # but for the points next to the roof's last ones
        assert (found.building_id[is_house & (x > 17.5)] > 0).all()
        assert (found.building_id[~is_house] == 0).all()
        coarse = FootprintConfig(min_gap_area=100.0)
        assert not assign_footprints(half, footprints(HOUSE), coarse).building_id[annexe].any()


def test_walls_and_branches_beside_roof_points_are_not_taken():
    tile = town(HOUSE)
    x, y = tile.points[:, 0], tile.points[:, 1]
    wall = (tile.classification == 6) & (x > 19)
    branch = (tile.classification == 6) & (np.hypot(x - 14, y - 14) < 0.9)
    other = tile.with_columns(
        classification=np.where(branch, 5, tile.classification), facade=wall.astype(np.uint8)
    )
    found = assign_footprints(other, footprints(HOUSE))
    assert not found.building_id[wall | branch].any()


def test_of_what_stands_there_last_returns_come_first():
    tile = town(HOUSE)
    n = len(tile)
    returns = {"return_number": 1 + np.arange(n) % 2, "number_of_returns": np.full(n, 2)}
    hidden = tile.with_columns(classification=np.where(tile.classification == 6, 5, 2), **returns)
    found = assign_footprints(hidden, footprints(HOUSE))
    assert (hidden.return_number[found.building_id > 0] == 2).all()


def test_what_is_neither_roof_nor_stands_is_never_taken():
    tile = town(HOUSE)
    for code in (2, 7, 9, 11, 18):
        other = tile.with_columns(classification=np.full(len(tile), code))
        found = assign_footprints(other, footprints(HOUSE))
        assert not found.building_id.any()
        assert len(found.outlines) == 1


def test_footprints_without_points_and_across_the_edge_are_there_and_those_outside_are_not():
    tile = town()
    empty = tile.select(~shapely.contains_xy(HOUSE, tile.points[:, :2]))
    outside = shapely.box(41, 10, 44, 14)
    given = footprints(HOUSE, outside)
    found = assign_footprints(empty, given)
    assert [one.building_id for one in found.outlines] == [given.building_id[0]]
    assert found.outlines[0].ground_elevation == 1.0
    assert not found.building_id.any()
    given = footprints(shapely.box(-20, 10, 5, 20))
    assert len(assign_footprints(town(), given).outlines) == 1


@pytest.mark.parametrize("edge", [12.0, 15.0, 19.0])
def test_of_two_tiles_just_one_has_a_footprint_on_their_border(edge):
    tile = town(HOUSE)
    given = footprints(HOUSE)
    found = [
        assign_footprints(tile.with_columns(buffer=is_buffer), given)
        for is_buffer in (tile.points[:, 0] > edge, tile.points[:, 0] <= edge)
    ]
    assert [len(each.outlines) for each in found] == [1, 0]
    assert (found[0].building_id > 0).sum() == (tile.classification == 6).sum()


def test_a_footprint_that_reaches_beyond_the_tile_asks_for_more_of_it():
    given = footprints(HOUSE)
    for east, is_clipped in ((19.0, True), (21.0, False)):
        tile = town(HOUSE)
        cut = tile.select(tile.points[:, 0] <= east)
        bounded = PointTile(cut.points, **cut.columns, bounds=(-5.0, -5.0, east, 45.0))
        assert assign_footprints(bounded, given).clipped == Sides(east=is_clipped)


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.2])
@pytest.mark.parametrize("n", [999, 20_000, 200_000])
def test_polygons_of_very_many_vertices_are_simplified_within_their_noise(n, noise):
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    radius = 12.0 + np.random.default_rng(0).uniform(-noise, noise, n)
    given = shapely.Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    repairs = repaired_polygons(array(given, HOUSE))
    assert shapely.get_num_coordinates(repairs.polygons[0]) <= 1001
    assert repairs.polygons[0].area == pytest.approx(given.area, rel=0.02)
    assert repairs.n_simplified == (n > 999)
    assert shapely.equals_exact(repairs.polygons[1], HOUSE)


def test_a_polygon_of_very_many_teeth_is_left_out_and_counted():
    angle = np.linspace(0.0, 2.0 * np.pi, 60_000, endpoint=False)
    radius = np.where(np.arange(60_000) % 2, 15.0, 10.0)
    teeth = shapely.Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    repairs = repaired_polygons(array(teeth, HOUSE))
    assert repairs.dropped == {"with too many vertices": 1}
    assert len(repairs.polygons) == 1
