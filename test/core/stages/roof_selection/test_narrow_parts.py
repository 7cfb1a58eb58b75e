"""What is too narrow for its level is told from dormers and wings."""

import numpy as np
import pytest
from scipy import ndimage

from lidar_buildings.core.neighbours.columns import by_column
from lidar_buildings.core.stages.roof_selection.smooth_patches.narrow_parts import (
    LEVEL_STEP,
    of_buildings,
    wide_enough,
)
from lidar_buildings.core.surfaces.morphology import square_distances
from lidar_buildings.core.surfaces.surface_patches import connected_columns, plan_areas

CELL = 0.4


def wide(points, building=3.0, part_of_roof=2.5):
    """Return which points are of buildings and wide enough, in their order; parts of 12 m² are opened."""
    columns, found = by_column(points, CELL), np.empty(len(points), dtype=bool)
    part = connected_columns(columns, LEVEL_STEP)
    area = plan_areas(part, part.max(initial=-1) + 1, columns.first, CELL)
    kept = of_buildings(columns, part, area, building)
    found[columns.rows] = kept & wide_enough(columns, part, area < 12.0, part_of_roof)
    return found


def box(x, y, z, step=0.3):
    """A level sheet over x from, to and y from, to."""
    a, b = np.meshgrid(np.arange(*x, step), np.arange(*y, step))
    return np.column_stack([a.ravel(), b.ravel(), np.full(a.size, z)])


HOUSE = box((0, 20), (0, 12), 9.0)


def kept(part, **widths):
    """Return how much of a part and of the house beside it stays."""
    points = np.vstack([HOUSE, part])
    found = wide(points, **widths)
    return found[len(HOUSE) :].mean(), found[: len(HOUSE)].mean()


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


def test_what_stands_alone_goes_unless_it_is_as_wide_as_a_building_somewhere():
    lorry, shed, far = box((0, 14), (0, 2.4), 4.0), box((40, 46), (0, 4), 3.0), HOUSE + np.array([0, 80, 0])
    points = np.vstack([lorry, shed, far])
    np.testing.assert_array_equal(wide(points), np.arange(len(points)) >= len(lorry))
    assert wide(points, building=0.0).all()


def test_a_missing_point_makes_nothing_narrow():
    garage = box((0, 4.8), (0, 4.8), 3.0)
    assert wide(np.delete(garage, len(garage) // 2, axis=0)).all()


def test_the_order_of_points_and_how_far_others_are_do_not_matter():
    points = np.vstack([HOUSE, box((4, 10), (12, 13.5), 5.0), HOUSE + np.array([5000, 0, 0])])
    shuffle = np.random.default_rng(1).permutation(len(points))
    straight = wide(points)
    np.testing.assert_array_equal(wide(points[shuffle]), straight[shuffle])
    assert (~straight).sum() == len(box((4, 10), (12, 13.5), 5.0))


def test_widths_of_too_few_cells_are_not_looked_at():
    balcony = box((4, 10), (12, 13.5), 5.0)
    assert kept(balcony, part_of_roof=4.9 * CELL) == (1.0, 1.0)
    assert kept(box((20.4, 34), (4, 4.5), 4.0), building=1.9 * CELL, part_of_roof=0.0) == (1.0, 1.0)
    assert len(wide(np.zeros((0, 3)))) == 0


@pytest.mark.parametrize("value", [0, 1])
def test_distances_are_those_of_scipy_up_to_the_reach(value):
    plan = (np.random.default_rng(0).random((40, 30)) < 0.9).astype(np.uint8)
    plan[5:20, 8:22] = 1 - value
    expected = np.rint(ndimage.distance_transform_edt(plan != value) ** 2)
    np.testing.assert_array_equal(square_distances(plan, value, 4), np.minimum(expected, 25))
