import numpy as np
import pytest

from bench.scenes import buildings as scenes
from lidar_buildings.core.surfaces.opened_terrain import opened_terrain


def height_above(points):
    """Heights above the terrain that is left of objects up to 60 m wide."""
    return points[:, 2] - opened_terrain(points, 30.0, 0.15, 1.0)[0]


@pytest.mark.parametrize("name", ["gable", "courtyard", "house_on_slope", "sparse"])
def test_heights_of_ground_are_small_and_of_roofs_large(name):
    scene = getattr(scenes, name)(density=8.0)
    height = height_above(scene.points)
    # On a slope of 25 % the lowest point of a cell lies up to a cell's rise, here 0.4 m, below the others.
    assert np.quantile(np.abs(height[scene.is_ground]), 0.95) < 0.5
    assert height[scene.is_roof].min() > 2.0


def test_one_false_low_point_does_not_pull_the_ground_down():
    scene = scenes.flat(density=8.0)
    low = np.append(scene.points[scene.is_ground][500, :2], scenes.GROUND - 30)
    height = height_above(np.vstack([scene.points, low]))
    assert height[-1] < -25
    assert np.quantile(np.abs(height[:-1][scene.is_ground]), 0.95) < 0.15


def test_the_order_of_points_does_not_matter():
    points = scenes.gable().points
    shuffle = np.random.default_rng(0).permutation(len(points))
    assert np.array_equal(height_above(points)[shuffle], height_above(points[shuffle]))


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.ones((1, 3)),
        np.ones((20, 3)),
        np.arange(50.0)[:, None] * [1, 0, 0],
        np.array([[0, 0, 0], [1e8, 1e8, 3.0]]),
    ],
    ids=["empty", "single", "identical", "collinear", "far apart"],
)
def test_degenerate_clouds_have_finite_heights(points):
    height = height_above(points)
    assert height.shape == (len(points),)
    assert np.isfinite(height).all()
