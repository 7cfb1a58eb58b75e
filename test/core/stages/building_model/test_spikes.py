"""Corners of roofs that no point explains are found and kept from."""

import numpy as np
import pytest

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.plan_graph import RoofPiece
from lidar_buildings.core.solids.raising import extrude, roof_solid
from lidar_buildings.core.stages.building_model.cells import cut_into_cells
from lidar_buildings.core.stages.building_model.spikes import MARGIN, limits_of, spikes_of

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
SPACING = 0.4
POINTS = np.column_stack([np.random.default_rng(0).uniform(0.0, 10.0, (600, 2)), np.full(600, 6.0)])


def tilted(rise):
    """A roof through the middle of level points, whose sides rise and sink."""
    return roof_solid([RoofPiece((SQUARE,), (rise, 0.0, 6.0 - 5.0 * rise))], 0.0)


@pytest.mark.parametrize("rise", [0.0, 0.05])
def test_corners_near_the_points_are_no_spikes(rise):
    assert not list(spikes_of(tilted(rise), POINTS, SPACING))


@pytest.mark.parametrize("rise", [0.5, -0.5])
def test_corners_far_above_and_below_all_points_near_are_spikes(rise):
    found = list(spikes_of(tilted(rise), POINTS, SPACING))
    assert len(found) == 4
    for spike in found:
        beyond = abs(spike.xyz[2] - 6.0) - MARGIN - 0.5 * SPACING
        assert abs(spike.excess) == pytest.approx(beyond, abs=0.01)
        assert (spike.excess > 0.0) == (spike.xyz[2] > 6.0)


def cells_of(ring, cut_at):
    return cut_into_cells(Outline(np.array(ring)), np.array([[[cut_at, -1.0], [cut_at, 11.0]]]))


def test_a_corner_of_a_face_is_left_where_its_plane_rises_above_the_points_near():
    cells = cells_of(SQUARE, 8.0)
    planes = np.where(cells.areas[:, None] > 50.0, [0.0, 0.0, 6.0], [1.0, 0.0, -2.0])
    limits = limits_of(POINTS[np.argsort(POINTS[:, 1])], SPACING, 0.0)
    cell, corners = limits.corners_left(cells, planes, np.arange(len(cells.vertices)))
    assert np.unique(cells.areas[cell]).tolist() == [20.0]
    assert sorted(corners.tolist()) == [[10.0, 0.0, 1.0], [10.0, 10.0, 1.0]]
    not_allowed = limits.not_allowed(cells, np.array([[0.0, 0.0, 6.0], [1.0, 0.0, -2.0]]), corners)
    assert not_allowed[cells.areas < 50.0].tolist() == [[False, True]]
    assert not not_allowed[cells.areas > 50.0].any()


def test_planes_that_cross_on_a_border_have_a_corner_there():
    cells = cells_of(SQUARE, 5.0)
    middle = POINTS[:, 2] + 3.0 * (np.abs(POINTS[:, 1] - 5.0) < 2.0)  # what both planes miss
    points = np.column_stack([POINTS[:, :2], middle])[np.argsort(POINTS[:, 1])]
    planes = np.array([[0.0, 0.05, 5.75], [0.0, -0.05, 6.25]])
    _, corners = limits_of(points, SPACING, 0.0).corners_left(cells, planes, np.arange(len(cells.vertices)))
    assert np.unique(corners, axis=0) == pytest.approx(np.array([[5.0, 5.0, 0.05]]))


def test_a_corner_is_cut_off_between_high_points_and_low_ones():
    low = POINTS + np.array([10.0, 0.0, -4.0])
    points = np.concatenate([POINTS, low])
    limits = limits_of(points[np.argsort(points[:, 1])], SPACING, 0.0)
    (cell,) = cells_of([[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [0.0, 10.0]], 30.0).polygons
    (segment,) = limits.cut_off(cell, POINTS[:, :2], np.array([20.0, 10.0]))
    assert segment[:, 0] == pytest.approx(10.0, abs=3.0 * SPACING)
    assert np.ptp(segment[:, 1]) > 10.0
    (segment,), heights = limits.level(cell, points, np.empty((0, 3)))
    assert (round(segment[0, 0]), heights) == (10, [])


def test_a_level_roof_is_offered_at_the_height_of_its_points_where_that_is_allowed():
    limits = limits_of(POINTS[np.argsort(POINTS[:, 1])], SPACING, 0.0)
    (cell,) = cells_of(SQUARE, 30.0).polygons
    assert limits.level(cell, POINTS, np.empty((0, 3))) == ([], [6.0])


def test_no_roof_lies_below_the_floor_where_points_do_not():
    limits = limits_of(POINTS[np.argsort(POINTS[:, 1])], SPACING, 5.4)
    place = np.array([[5.0, 5.0]])
    assert limits.are_left(place, np.array([5.3]), np.array([1.0])).all()
    assert not limits._replace(floor=0.0).are_left(place, np.array([5.3]), np.array([1.0])).any()


def test_corners_of_a_courtyard_are_looked_at():
    outer = np.array([[0, 0], [10, 0], [10, 10], [0, 10]], dtype=float)
    yard = np.array([[4, 4], [4, 6], [6, 6], [6, 4]], dtype=float)
    solid = extrude(Outline(outer, (yard,)), 0.0, 6.0)
    x, y = (one.ravel() for one in np.meshgrid(np.arange(0.25, 10.0, 0.5), np.arange(0.25, 10.0, 0.5)))
    is_near_yard = np.maximum(abs(x - 5.0), abs(y - 5.0)) < 3.0
    points = np.column_stack([x, y, np.where(is_near_yard, 3.0, 6.0)])
    found = {spike.xyz[:2] for spike in spikes_of(solid, points[np.argsort(points[:, 1])], 0.5)}
    assert found == set(map(tuple, yard.tolist()))
