import numpy as np
import pytest
from support.lattice import lattice

from lidar_buildings.core.stages.ground_filter.classification import classify_ground
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.progressive_tin import grown_ground

CONFIG = GroundFilterConfig(method="progressive_tin")


def is_ground(points, config=CONFIG):
    """Which points `classify_ground` calls ground."""
    return classify_ground(points, config).classification == 2


@pytest.mark.parametrize("run", [3.0, 5.0])
def test_without_growth_by_wider_limits_a_steep_bank_is_lost_that_is_found_with_it(run):
    # Narrower than a seed cell, so that no seed lies on it.
    points = lattice(140.0, 140.0, is_centred=True)
    away = abs(points[:, :2]).max(axis=1)
    points[:, 2] += 4.0 * np.clip((15.0 - away) / run, 0, 1)
    assert is_ground(points).mean() > 0.995
    cautious = is_ground(points, GroundFilterConfig(method="progressive_tin", landform_distance=0.0))
    assert cautious[away > 15.0].all()
    assert cautious[away < 15.0].mean() < 0.2


def test_bushes_on_open_hillsides_are_fewer_where_open_terrain_is_judged_like_a_town():
    points = lattice(100.0, 100.0, is_centred=True)
    bush = np.hypot(points[:, 0] % 10.0 - 5.0, points[:, 1] % 10.0 - 5.0) < 1.3
    points[:, 2] += 0.3 * points[:, 0]
    points[bush, 2] += np.random.default_rng(0).uniform(1.0, 1.8, bush.sum())
    alike = GroundFilterConfig(method="progressive_tin", max_open_steep_share=CONFIG.max_steep_share)
    assert is_ground(points, alike)[bush].mean() < 0.6 * is_ground(points)[bush].mean()


def test_a_rough_slope_is_the_ground_that_its_candidates_make_up():
    candidates = lattice(60.0, 60.0, 1.2, is_centred=True)
    candidates[:, 2] += 0.3 * candidates[:, 0]
    extent = np.array([candidates[:, :2].min(axis=0), candidates[:, :2].max(axis=0)])
    ground, _ = grown_ground(candidates, extent, 1.2, CONFIG)
    assert ground.all()


@pytest.mark.parametrize(
    "candidates",
    [
        [[1.0, 2.0, 3.0]],
        [[1.0, 2.0, 3.0], [4.0, 5.0, 3.2]],
        [[1.5 * k, 0.5 * k, 7.0] for k in range(60)],
        [[0.0, 0.0, 0.0], [1e6, 1e6, 0.1], [5.0, 5.0, 0.0]],
        [[20.0 * k, 60.0 * (k % 3), 2.0] for k in range(40)],
    ],
    ids=["one", "two", "collinear", "huge", "sparse"],
)
def test_few_or_odd_candidates_are_all_ground(candidates):
    candidates = np.array(candidates)
    extent = np.array([candidates[:, :2].min(axis=0) - 1.0, candidates[:, :2].max(axis=0) + 1.0])
    assert grown_ground(candidates, extent, 1.0, CONFIG)[0].all()
