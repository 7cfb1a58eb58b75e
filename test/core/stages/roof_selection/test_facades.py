"""Façades lie below the edges of roofs, and light wells between roofs."""

import numpy as np
import pytest

from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.roof_selection.candidates import surroundings
from lidar_buildings.core.stages.roof_selection.facades import TOP_REACH, find_facades

SPACING = 0.25


def roof(x_from, x_to, z=8.0):
    x, y = np.meshgrid(np.arange(x_from, x_to, SPACING), np.arange(0.0, 10.0, SPACING))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])


def facades(roofs, others, *, is_last=True, reach=0.2, spacing=SPACING, order=None):
    points = np.vstack([roofs, others])
    order = np.arange(len(points)) if order is None else order
    is_roof = np.arange(len(points)) < len(roofs)
    columns = sort_by_cell(points[order], 0.5)
    own = is_roof[order][columns.rows]
    highest = surroundings(columns, own, TOP_REACH, ~own).highest
    last = np.full(len(points), is_last)
    back = np.empty(len(points), dtype=bool)
    back[order[columns.rows]] = find_facades(
        columns, columns.points[:, 2], own, last, highest, reach, spacing
    )
    assert not back[: len(roofs)].any()
    return back[len(roofs) :]


def column(x, z_from=0.0, z_to=8.0, y=5.0):
    z = np.arange(z_from, z_to, 0.1)
    return np.column_stack([np.full(len(z), x), np.full(len(z), y), z])


def test_a_wall_under_the_edge_is_facade_from_its_foot_to_the_eave():
    wall = column(9.9)
    found = facades(roof(0.0, 10.0), wall)
    assert found[(wall[:, 2] > 0.9) & (wall[:, 2] < 8.0)].all()
    assert not found[(wall[:, 2] < 0.7) | (wall[:, 2] > 8.0)].any()


def test_what_stands_away_from_the_roof_in_plan_is_none_and_without_a_reach_nothing_is():
    assert not facades(roof(0.0, 10.0), column(10.6)).any()
    assert not facades(roof(0.0, 10.0), column(9.9), reach=0.0).any()


@pytest.mark.parametrize(("is_last", "farthest"), [(True, 1.1), (False, 0.5)])
def test_where_points_lie_far_apart_only_what_ends_its_pulse_is_facade_far_from_the_edge(is_last, farthest):
    eave = roof(0.0, 10.0)[:, 0].max()
    for away in (0.4, 0.6, 1.0, 1.2):
        found = facades(roof(0.0, 10.0), column(eave + away, 2.0), is_last=is_last, spacing=1.6)
        assert (found == (away < farthest)).all()


def test_a_light_well_is_of_the_building_if_the_pulse_ends_there():
    well = column(10.75, 1.0, 7.0)
    roofs = np.vstack([roof(0.0, 10.0), roof(11.5, 20.0)])
    assert facades(roofs, well).all()
    assert not facades(roofs, well, is_last=False).any()
