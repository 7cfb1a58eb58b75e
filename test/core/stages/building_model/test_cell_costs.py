import numpy as np
import pytest

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.building_model.cell_costs import by_square, plane_costs
from lidar_buildings.core.stages.building_model.cells import cut_into_cells

SPACING = 0.5
LOW, STEEP = [0.0, 0.0, 3.0], [4.0, 0.0, -33.0]  # level at 3 m; 7 m above x = 10


def costs_of(points, width=20.0, cut_at=9.8):
    """Costs of a house of two cells, the eastern one without points of its own: what it costs to run on."""
    house = Outline(np.array([[0.0, 0.0], [width, 0.0], [width, 10.0], [0.0, 10.0]]))
    cells = cut_into_cells(house, np.array([[[cut_at, 0.0], [cut_at, 10.0]]]))
    cell = np.full(len(points), -1, dtype=np.int64)
    near = by_square(points, 3.0 * SPACING)
    costs = plane_costs(points, near, np.ones(len(points)), cell, cells, np.array([LOW, STEEP]), SPACING)
    return dict(zip(cells.areas.round(2).tolist(), costs, strict=True))


def level_points(x_end, z=3.0):
    x, y = np.meshgrid(np.arange(0.25, x_end, SPACING), np.arange(0.25, 10.0, SPACING))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])


def test_a_plane_above_the_returns_around_a_strip_costs_even_where_the_house_is_higher_elsewhere():
    points = np.vstack([level_points(10.0), [[1.0, 1.0, 60.0]]])  # an antenna far away
    low, steep = costs_of(points, width=10.0, cut_at=9.8)[2.0]
    assert low == 0.0
    # 7 m at x = 10 instead of 3 m, 0.3 m and a spacing of a slope of 4 beside: over 2 m²
    assert steep == pytest.approx(2.0 * (4.0 - 0.3 - 4.0 * SPACING))


def test_a_corner_speaks_for_no_more_of_a_cell_than_its_surroundings():
    low, steep = costs_of(level_points(20.0), width=20.0, cut_at=1.0)[190.0]
    assert low == 0.0
    top = 4.0 * 20.0 - 33.0 - 3.0 - 0.3 - 4.0 * SPACING
    assert steep == pytest.approx((5 * SPACING) ** 2 * top)


def test_where_nothing_was_seen_around_the_highest_of_all_counts():
    low, steep = costs_of(level_points(5.0, z=3.0), width=10.0, cut_at=9.8)[2.0]
    assert (low, steep) == (0.0, pytest.approx(2.0 * (4.0 - 0.3 - 4.0 * SPACING)))
    assert costs_of(np.vstack([level_points(5.0), [[1.0, 1.0, 60.0]]]), width=10.0)[2.0][1] == 0.0


def test_a_plane_below_all_returns_around_a_corner_costs_as_one_above_does():
    low, _ = costs_of(level_points(10.0, z=8.0), width=10.0, cut_at=9.8)[2.0]
    assert low == pytest.approx(2.0 * (5.0 - 0.3))
