import numpy as np
import pytest

from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.smooth_patches import LEVEL_STEP, narrow_levels
from lidar_buildings.core.surfaces.surface_patches import connected_columns, plan_areas

CELL = 0.4


def wide(points, config=None, **kind):
    """Return which points are on wide levels, in their order."""
    columns, found = sort_by_cell(points, CELL), np.empty(len(points), dtype=bool)
    part = connected_columns(columns, LEVEL_STEP)
    area = plan_areas(part, part.max(initial=-1) + 1, columns.first, CELL)
    found[columns.rows] = narrow_levels(columns, part, area, config or RoofSelectionConfig(), **kind) == 0
    return found


def box(x, y, z, step=0.3):
    """A level sheet over x from, to and y from, to."""
    a, b = np.meshgrid(np.arange(*x, step), np.arange(*y, step))
    return np.column_stack([a.ravel(), b.ravel(), np.full(a.size, z)])


HOUSE = box((0, 20), (0, 12), 9.0)


def kept(part, house=HOUSE, config=None):
    """Return how much of a part and of the house beside it stays."""
    points = np.vstack([house, part])
    found = wide(points, config)
    return found[len(house) :].mean(), found[: len(house)].mean()


@pytest.mark.parametrize(
    ("part", "share"),
    [
        (box((4, 10), (12, 13.5), 5.0), 0.0),
        (box((4, 10), (12, 16), 5.0), 1.0),
        (box((4, 5), (4, 5), 11.0), 1.0),
        (box((2, 12), (4, 4.6), 10.5), 1.0),
        (box((20.4, 34), (4, 6.3), 4.0), 0.0),
        (box((20.4, 34), (4, 8.5), 4.0), 1.0),
        (box((2, 16), (12, 14.3), 4.0), 1.0),
    ],
    ids=["balcony", "annex", "chimney", "duct", "lorry at a dock", "wing", "lean-to"],
)
def test_what_is_narrow_on_its_level_goes_unless_it_stands_on_a_roof_or_leans_on_one(part, share):
    assert kept(part) == (share, 1.0)


@pytest.mark.parametrize(
    ("part", "is_kept"),
    [
        (box((20.4, 34), (4, 6.3), 4.0), False),
        (box((30, 44), (4, 6.3), 4.0), True),
        (box((4, 10), (12, 13.5), 5.0), True),
    ],
    ids=["lorry at a dock", "lorry in the yard", "balcony"],
)
def test_before_roofs_are_complete_only_what_touches_one_with_an_end_goes(part, is_kept):
    found = wide(np.vstack([HOUSE, part]), is_bare=True)
    assert found[: len(HOUSE)].all()
    assert found[len(HOUSE) :].all() if is_kept else not found[len(HOUSE) :].any()


def test_the_order_of_points_and_how_far_others_are_do_not_matter():
    points = np.vstack([HOUSE, box((4, 10), (12, 13.5), 5.0), HOUSE + np.array([5000, 0, 0])])
    shuffle = np.random.default_rng(1).permutation(len(points))
    straight = wide(points)
    np.testing.assert_array_equal(wide(points[shuffle]), straight[shuffle])
    assert (~straight).sum() == len(box((4, 10), (12, 13.5), 5.0))


def test_what_stands_alone_goes_unless_it_is_as_wide_as_a_building_somewhere():
    lorry, shed, far = box((0, 14), (0, 2.4), 4.0), box((40, 46), (0, 4), 3.0), HOUSE + np.array([0, 80, 0])
    points = np.vstack([lorry, shed, far])
    np.testing.assert_array_equal(wide(points), np.arange(len(points)) >= len(lorry))
    assert wide(points, RoofSelectionConfig(min_building_width=0.0)).all()


def test_widths_below_two_cells_are_not_looked_at():
    narrow = RoofSelectionConfig(min_roof_width=0.5)
    assert kept(box((4, 10), (12, 13.5), 5.0), config=narrow) == (1.0, 1.0)
    assert len(wide(np.zeros((0, 3)))) == 0
