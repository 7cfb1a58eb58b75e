import numpy as np
import pytest

from bench.scenes.roofs import ROOF_SCENES
from lidar_buildings.core.stages.roof_selection import select_roofs
from lidar_buildings.core.stages.roof_selection.smooth_patches.parapets import find_parapets


def flat_roof():
    x, y = np.meshgrid(np.arange(0, 10, 0.4), np.arange(0, 8, 0.4))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 6.0)])


def rim(rise, length=8.0):
    """A row of points along the roof's southern edge."""
    x = np.arange(0, length, 0.3)
    return np.column_stack([x, np.full(len(x), -0.3), 6.0 + np.broadcast_to(rise, len(x))])


def share(others):
    points = np.vstack([flat_roof(), others])
    is_roof = np.arange(len(points)) < len(flat_roof())
    found = find_parapets(points, is_roof, is_roof, 0.8)
    assert not found[is_roof].any()
    return found[~is_roof].mean()


@pytest.mark.parametrize(
    ("others", "expected"),
    [
        (rim(0.9), 1.0),
        (rim(2.5), 0.0),
        (rim(-0.9), 0.0),
        (rim(0.9, 1.2), 0.0),
        (rim(np.random.default_rng(0).uniform(0.2, 1.5, 27)), 0.0),
        (rim(0.9) - [0, 2.0, 0], 0.0),
    ],
    ids=["parapet", "too high", "a wall below", "too short", "leaves", "beside the building"],
)
def test_even_rims_a_little_above_a_roof_are_parapets(others, expected):
    assert share(others) == expected


def test_the_order_of_points_does_not_matter():
    points = np.vstack([flat_roof(), rim(0.9), rim(1.2) + np.array([0, 8.4, 0])])
    is_roof = np.arange(len(points)) < len(flat_roof())
    straight = find_parapets(points, is_roof, is_roof, 0.8)
    shuffle = np.random.default_rng(0).permutation(len(points))
    shuffled = find_parapets(points[shuffle], is_roof[shuffle], is_roof[shuffle], 0.8)
    np.testing.assert_array_equal(shuffled, straight[shuffle])


def test_flat_roofs_keep_their_parapets():
    scene = ROOF_SCENES["parapet_roofs"]()
    result = select_roofs(scene.points, **scene.columns)
    roof = (result.classification == 6) & ~result.is_facade
    assert roof[scene.is_building].mean() > 0.98
    assert scene.is_building[roof & scene.is_judged].mean() > 0.98
