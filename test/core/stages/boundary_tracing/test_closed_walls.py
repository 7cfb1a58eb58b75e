"""Outlines are closed behind walls that enclose something; what was not seen is not made up elsewhere."""

import numpy as np
import pytest
import shapely

from lidar_buildings.core.stages.boundary_tracing.closed_walls import (
    GROUND_CELL,
    MAX_DEPTH,
    WALL_CELL,
    close_walls,
)

HOUSE = shapely.box(0.0, 0.0, 12.0, 9.0)
#: The house less a corner at the street, and with a wing toward it.
NOTCHED = shapely.Polygon([(0, 4), (5, 4), (5, 0), (12, 0), (12, 9), (0, 9)])
TURN = 0.4


def turned(xy, angle=TURN):
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(xy, dtype=float) @ np.array([[c, s], [-s, c]])


def cells(xy, size):
    return (np.unique(np.floor(np.asarray(xy).reshape(-1, 2) / size), axis=0) + 0.5) * size


def on_walls(*corners, random=None, noise=0.02):
    """Points along a line through corners, two a decimetre."""
    line = shapely.LineString(corners)
    xy = shapely.get_coordinates(shapely.line_interpolate_point(line, np.arange(0.0, line.length, 0.05)))
    return xy + (random or np.random.default_rng(5)).normal(0.0, noise, xy.shape)


def inside(area, step=0.3):
    low_x, low_y, high_x, high_y = area.bounds
    x, y = np.meshgrid(np.arange(low_x, high_x, step), np.arange(low_y, high_y, step))
    keep = shapely.contains_xy(area, x, y)
    return np.column_stack([x[keep], y[keep]])


def street(building):
    """Ground on all sides of what a car in the south sees of a building."""
    return inside(shapely.box(-10.0, -10.0, 22.0, 9.0).difference(building.buffer(0.05)))


def closed(walls, building=HOUSE, roofs=None, ground=None, bare=None, angle=TURN):
    roofs = np.zeros((0, 2)) if roofs is None else roofs
    ground = street(building) if ground is None else ground
    found = close_walls(
        cells(turned(walls, angle), WALL_CELL),
        cells(turned(walls if bare is None else bare, angle), WALL_CELL),
        cells(turned(roofs, angle), GROUND_CELL) if len(roofs) else roofs,
        cells(turned(ground, angle), GROUND_CELL),
    )
    found = [shapely.transform(one.polygon, lambda xy: turned(xy, -angle)) for one in found]
    assert len(found) <= 1
    return found[0] if found else None


def iou(one, other):
    return one.intersection(other).area / one.union(other).area


@pytest.mark.parametrize("angle", [0.0, TURN, 1.2, -0.7])
def test_two_sides_of_a_house_make_a_rectangle(angle):
    found = closed(on_walls((0, 9), (0, 0), (12, 0)), angle=angle)
    assert iou(found, HOUSE) > 0.97
    assert found.is_valid


def test_ground_that_was_seen_is_no_part_of_the_building():
    found = closed(on_walls((0, 9), (0, 4), (5, 4), (5, 0), (12, 0), (12, 9)), NOTCHED)
    assert iou(found, NOTCHED) > 0.96


def test_a_party_wall_through_a_window_and_a_parapet_make_no_corners():
    walls = np.concatenate([on_walls((0, 9), (0, 0), (12, 0), (12, 9)), on_walls((4, 0.3), (4, 6))])
    found = closed(np.concatenate([walls, on_walls((0.5, 0.4), (11.5, 0.4))]))
    assert iou(found, HOUSE) > 0.96
    assert len(shapely.simplify(found, 0.05).exterior.coords) == 5


def test_half_a_roof_and_the_gables_make_the_whole():
    front, gables = on_walls((0, 0), (12, 0)), [on_walls((0, 0), (0, 9)), on_walls((12, 0), (12, 9))]
    bare = np.concatenate([one[one[:, 1] > 5.0] for one in gables])
    walls = np.concatenate([front, *gables])
    seen = inside(shapely.box(-0.4, -0.4, 12.4, 4.5))
    assert iou(closed(walls, roofs=seen, bare=bare), HOUSE) > 0.97
    assert closed(walls, roofs=inside(HOUSE), bare=bare) is None, "the roof tells the outline"
    tree = shapely.Point(8.0, 5.0).buffer(2.0)
    assert closed(walls, roofs=inside(HOUSE.difference(tree)), bare=bare) is None, "seen but for a tree"
    assert closed(walls, roofs=seen, bare=bare[:20]) is None, "its own roof ends there"


@pytest.mark.parametrize(
    "walls",
    [
        on_walls((0, 0), (30, 0)),
        on_walls((0, 0), (12, 0), (12, 0.8)),
        on_walls(*[(6 * np.cos(t), 6 * np.sin(t)) for t in np.linspace(np.pi, 2 * np.pi, 60)]),
        on_walls((-8, 6), (0, 0), (12, 0)),
        on_walls((0, MAX_DEPTH + 10), (0, 0), (MAX_DEPTH + 10, 0)),
    ],
    ids=["one side", "one side and its end", "round", "an oblique corner", "a yard"],
)
def test_what_walls_do_not_enclose_has_no_outline(walls):
    assert closed(walls, building=shapely.box(-20, 0, 60, 60)) is None


def test_ground_on_both_sides_of_walls_leaves_no_building():
    assert closed(on_walls((0, 9), (0, 0), (12, 0)), ground=inside(shapely.box(-10, -10, 22, 20))) is None


@pytest.mark.parametrize(("noise", "pitch"), [(0.08, 0.05), (0.02, 0.4)])
@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_noise_and_a_scanner_that_drives_fast_make_no_wall_winding(noise, pitch, angle):
    line = shapely.LineString([(0, 9), (0, 0), (12, 0)])
    xy = shapely.get_coordinates(shapely.line_interpolate_point(line, np.arange(0.0, line.length, pitch)))
    found = closed(xy + np.random.default_rng(2).normal(0.0, noise, xy.shape), angle=angle)
    assert iou(found, HOUSE) > 0.93


def test_two_houses_that_a_garden_wall_joins_are_two():
    second = shapely.box(20.0, 0.0, 32.0, 9.0)
    walls = [on_walls((x, 9), (x, 0), (x + 12, 0), (x + 12, 9)) for x in (0, 20)]
    walls = np.concatenate([*walls, on_walls((12, 4), (20, 4))])
    ground = inside(shapely.box(-10.0, -10.0, 42.0, 9.0).difference(HOUSE.union(second).buffer(0.05)))
    found = close_walls(
        cells(walls, WALL_CELL), cells(walls, WALL_CELL), np.zeros((0, 2)), cells(ground, 0.5)
    )
    areas = sorted(one.polygon.intersection(HOUSE.union(second)).area for one in found)
    assert areas == pytest.approx([HOUSE.area, HOUSE.area], rel=0.03)
    assert sum(one.area for one in found) == pytest.approx(2 * HOUSE.area, rel=0.03)
