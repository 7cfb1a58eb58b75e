"""What is too narrow to be a building is told by an opening in plan."""

import numpy as np
import pytest

from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.roof_selection.smooth_patches import wide_enough as of_columns

SPACING = 0.25


def wide_enough(points, cell, width):
    """Return which points are wide enough, in their order."""
    columns, found = sort_by_cell(points, cell), np.empty(len(points), dtype=bool)
    found[columns.rows] = of_columns(columns, width)[columns.cell]
    return found


def rectangle(width, length, x=0.0, y=0.0):
    across, along = np.meshgrid(np.arange(x, x + width, SPACING), np.arange(y, y + length, SPACING))
    return np.column_stack([across.ravel(), along.ravel(), np.full(across.size, 3.0)]) + SPACING / 2


@pytest.mark.parametrize(("width", "passes"), [(1.5, False), (2.0, False), (3.0, True), (8.0, True)])
def test_what_is_narrower_than_asked_for_goes(width, passes):
    found = wide_enough(rectangle(width, 10.0), SPACING, 2.5)
    assert found.all() if passes else not found.any()


def test_a_narrow_arm_goes_and_what_it_sticks_out_of_stays_whole():
    house, arm = rectangle(8.0, 8.0), rectangle(1.0, 6.0, x=3.0, y=8.0)
    found = wide_enough(np.vstack([house, arm]), SPACING, 2.5)
    assert found[: len(house)].all()
    far = arm[:, 1] > 8.0 + 2.5 / 2 + 2 * SPACING
    assert not found[len(house) :][far].any()


def test_a_courtyard_is_an_edge_and_a_missing_point_is_none():
    ring = rectangle(12.0, 12.0)
    ring = ring[~((abs(ring[:, :2] - 6.0) < 4.5).all(axis=1))]
    assert not wide_enough(ring, SPACING, 2.5).any()
    house = np.delete(rectangle(4.0, 4.0), 100, axis=0)
    assert wide_enough(house, SPACING, 2.5).all()


def test_far_parts_and_other_rows_change_nothing():
    house = rectangle(2.75, 9.0, x=120.0, y=-40.0)
    far = rectangle(6.0, 6.0, x=90_000.0, y=70_000.0)
    order = np.random.default_rng(0).permutation(len(house) + len(far))
    together = wide_enough(np.vstack([house, far])[order], SPACING, 2.5)
    alone = np.concatenate([wide_enough(house, SPACING, 2.5), wide_enough(far, SPACING, 2.5)])
    assert (together == alone[order]).all()


def test_blocks_do_not_show_where_a_roof_lies_across_them():
    # 512 cells of 0.25 m make a block of 128 m.
    inside, across = rectangle(2.75, 30.0, x=20.0), rectangle(2.75, 30.0, x=127.0, y=113.0)
    for points in (inside, across):
        assert wide_enough(points, SPACING, 2.5).all()
        assert not wide_enough(points, SPACING, 3.5).any()


def test_where_cells_are_too_large_to_tell_all_pass():
    assert wide_enough(rectangle(0.5, 10.0), 2.0, 2.5).all()
