import numpy as np
import pytest

from bench.scenes.roofs import ROOF_SCENES
from lidar_buildings.core.neighbours.columns import by_column
from lidar_buildings.core.stages.roof_selection import select_roofs
from lidar_buildings.core.stages.roof_selection.smooth_patches.canopies import is_canopy


def roof_with(above, holes=()):
    """A roof of 12 × 12 m without points below x from, to, y from, to; and others above it."""
    x, y = np.meshgrid(np.arange(0, 12, 0.4), np.arange(0, 12, 0.4))
    roof = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    for x0, x1, y0, y1 in holes:
        roof = roof[(roof[:, 0] < x0) | (roof[:, 0] > x1) | (roof[:, 1] < y0) | (roof[:, 1] > y1)]
    points = np.vstack([roof, above])
    is_roof = np.arange(len(points)) < len(roof)
    return points, is_roof


def crown(n=500, thickness=3.0):
    random = np.random.default_rng(0)
    return np.column_stack([random.uniform(4, 8, (n, 2)), random.uniform(1, 1 + thickness, n)])


def canopies(points, is_roof):
    """Return which points are canopy, in their order."""
    columns, found = by_column(points, 0.5), np.empty(len(points), dtype=bool)
    own = is_roof[columns.rows]
    found[columns.rows] = is_canopy(columns, own, ~own, 1.0)
    return found


def found(points, is_roof):
    canopy = canopies(points, is_roof)
    assert not canopy[is_roof].any()
    return canopy[~is_roof].mean()


def test_leaves_through_which_the_roof_is_seen_are_a_canopy():
    assert found(*roof_with(crown())) == 1.0


def test_a_solid_part_shades_the_roof_below_it():
    assert found(*roof_with(crown(), [(4, 8, 4, 8)])) == 0.0


def test_thin_things_over_a_roof_are_none():
    assert found(*roof_with(crown(thickness=1.0))) == 0.0


def test_parts_are_judged_one_by_one_in_any_order():
    points, is_roof = roof_with(
        np.vstack([crown() - [4, 0, 0], crown() + np.array([3.5, 0, 0])]), [(7.3, 11.7, 4, 8)]
    )
    straight = canopies(points, is_roof)
    np.testing.assert_array_equal(straight[~is_roof], np.repeat([True, False], 500))
    shuffle = np.random.default_rng(2).permutation(len(points))
    np.testing.assert_array_equal(canopies(points[shuffle], is_roof[shuffle]), straight[shuffle])


def test_nothing_above_a_roof_is_no_canopy():
    points, is_roof = roof_with(np.zeros((0, 3)))
    assert not canopies(points, is_roof).any()


@pytest.mark.parametrize("seed", [0, 1])
def test_trees_over_ridges_are_no_roof_even_without_return_numbers(seed):
    scene = ROOF_SCENES["without_returns"](seed=seed)
    result = select_roofs(scene.points, **scene.columns)
    roof = (result.classification == 6) & ~result.is_facade
    assert roof[scene.is_building].mean() > 0.97
    assert scene.is_building[roof].mean() > 0.94
