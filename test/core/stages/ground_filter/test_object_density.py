import numpy as np
import pytest

from lidar_buildings.core.stages.ground_filter.landforms import CELL, RADIUS, object_density


def density_by_brute_force(candidates, is_object):
    """What `object_density` returns, candidate by candidate."""
    cell = np.floor(candidates[:, :2] / CELL)
    density = np.empty(len(candidates))
    for i in range(len(candidates)):
        steps = cell - cell[i]
        weight = np.exp(-2 * (steps**2).sum(axis=1) / RADIUS**2) * (abs(steps) <= RADIUS).all(axis=1)
        density[i] = weight @ is_object / weight.sum()
    return density


@pytest.mark.parametrize("side", [30.0, 150.0, 500.0])
def test_the_density_is_the_weighted_share_counted_candidate_by_candidate(side):
    candidates = np.random.default_rng(0).uniform(-side / 2, side / 2, (600, 3))
    is_object = (candidates[:, 0] > 0) & (np.arange(600) % 5 == 0)
    found = object_density(candidates, is_object)
    np.testing.assert_allclose(found, density_by_brute_force(candidates, is_object), atol=1e-9)
