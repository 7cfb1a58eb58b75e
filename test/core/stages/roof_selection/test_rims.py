"""A building ends; a smooth spot in foliage goes on all around."""

import numpy as np
import pytest

from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.roof_selection.smooth_patches import stands_out

CELL = 1.0


def ends(points, is_roof):
    cells = sort_by_cell(points, CELL)
    return bool(stands_out(cells, cells.points[:, 2], np.where(is_roof[cells.rows], 0, -1), 1)[0])


def square(half, gap=0.0, height=8.0):
    """Points 0.5 m apart over a square about the origin, without a smaller one in its middle."""
    x, y = np.meshgrid(np.arange(-half, half, 0.5), np.arange(-half, half, 0.5))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)]) + 0.25
    return points[abs(points[:, :2]).max(axis=1) > gap]


def among(around):
    """A roof of 10 m and what stands around it."""
    roof = square(5.0)
    return np.vstack([roof, around]), np.arange(len(roof) + len(around)) < len(roof)


def test_a_house_by_itself_ends_and_a_spot_of_a_canopy_does_not():
    assert ends(*among(np.zeros((0, 3))))
    assert not ends(*among(square(15.0, 5.0)))


def test_a_house_below_trees_or_above_shrubs_ends():
    assert ends(*among(square(15.0, 5.0, height=14.0)))
    assert ends(*among(square(15.0, 5.0, height=4.0)))


@pytest.mark.parametrize("shift", [0.0, 0.3])
def test_a_parapet_is_an_end(shift):
    points, is_roof = among(square(5.5, 5.0, height=9.0))
    assert ends(points + shift, is_roof)


def test_trees_along_two_walls_leave_a_house_one_and_on_three_sides_do_not():
    trees = square(15.0, 5.0)
    x, y = trees[:, 0], trees[:, 1]
    assert ends(*among(trees[((y > 5.0) & (abs(x) < 5.0)) | ((x > 5.0) & (abs(y) < 5.0))]))
    assert not ends(*among(trees[y > -5.0]))


def test_other_roofs_beside_it_are_no_foliage():
    points, is_roof = among(square(15.0, 5.0))
    cells = sort_by_cell(points, CELL)
    assert stands_out(cells, cells.points[:, 2], np.where(is_roof, 0, 1)[cells.rows], 2).all()
