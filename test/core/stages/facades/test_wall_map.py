"""Walls, open ground, and what nothing is known of: in cells that fit those of other tiles."""

import numpy as np
import pytest

from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.core.stages.facades.wall_map import CLEARANCE, OPEN, UNKNOWN, WALL, wall_map


def facade(foot, *, is_core=True):
    line = np.array(foot, dtype=float)
    return Facade(line, 1.0, 3.0, np.ones(4, dtype=bool), 0.9, 0.01, 99, 0.9, "straight", is_core=is_core)


def mapped(ground, *facades, others=(), is_core=None):
    """Map ground and other points, each with its height, about façades."""
    points = np.array([*((x, y, 5.0) for x, y in ground), *((x, y, 5.0 + z) for x, y, z in others)])
    is_ground = np.arange(len(points)) < len(ground)
    core = np.ones(len(points), dtype=bool) if is_core is None else np.array(is_core)
    return wall_map(points.reshape(-1, 3), points.reshape(-1, 3)[:, 2] - 5.0, is_ground, core, facades)


def cell_at(shown, x, y):
    row, column = int((y - shown.south) // shown.resolution), int((x - shown.west) // shown.resolution)
    return shown.cells[row, column]


STREET = [(x, y) for x in np.arange(-0.9, 3.0, 0.1) for y in np.arange(-1.9, 0.0, 0.1)]


def test_a_foot_line_is_a_wall_seen_ground_is_open_and_the_rest_unknown():
    shown = mapped(STREET, facade([[0.1, 0.3], [2.1, 0.3]]), facade([[2.1, 0.3], [2.1, 2.3]]))
    assert all(cell_at(shown, x, 0.3) == WALL for x in np.arange(0.1, 2.1, 0.1))
    assert all(cell_at(shown, 2.1, y) == WALL for y in np.arange(0.3, 2.3, 0.1))
    assert cell_at(shown, 1.0, -1.0) == OPEN
    assert cell_at(shown, 1.0, 1.0) == UNKNOWN
    assert shown.elevation == 5.0


def test_a_line_through_cells_leaves_no_hole_between_them():
    shown = mapped(STREET, facade([[0.0, 0.03], [2.9, 1.97]]))
    rows, columns = np.nonzero(shown.cells == WALL)
    cells = set(zip(rows.tolist(), columns.tolist(), strict=True))
    assert all({(r + 1, c), (r, c + 1)} & cells for r, c in cells if (r, c) != max(cells))


@pytest.mark.parametrize(("height", "kind"), [(0.1, OPEN), (1.0, UNKNOWN), (CLEARANCE + 0.1, OPEN)])
def test_what_stands_on_the_ground_is_in_the_way_and_what_hangs_above_is_not(height, kind):
    assert cell_at(mapped(STREET, others=[(1.05, -1.05, height)]), 1.05, -1.05) == kind


def test_maps_of_tiles_that_adjoin_fit_and_share_the_wall_across_their_seam():
    line = [[-0.5, -0.5], [2.5, -0.5]]
    west = mapped(STREET, facade(line), is_core=[x < 1.0 for x, _ in STREET])
    east = mapped(STREET, facade(line, is_core=False), is_core=[x >= 1.0 for x, _ in STREET])
    assert (east.west / east.resolution, east.south) == (pytest.approx(5.0), west.south)
    assert cell_at(east, 1.1, -0.5) == WALL
    assert east.cells.shape[1] < west.cells.shape[1]


def test_a_tile_without_ground_and_facades_of_its_own_has_no_map():
    assert mapped([], others=[(0.0, 0.0, 1.0)]) is None
    assert mapped(STREET, facade([[0, 0], [1, 0]], is_core=False), is_core=[False] * len(STREET)) is None


def test_an_enormous_tile_has_larger_cells():
    shown = mapped([(0.0, 0.0), (9_000.0, 9_000.0)])
    assert shown.cells.size <= 2**24
    assert cell_at(shown, 9_000.0, 9_000.0) == OPEN
