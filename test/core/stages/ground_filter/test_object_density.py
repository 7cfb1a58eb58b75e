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


def scattered(n, side, seed=0):
    """Random points over a square about the origin."""
    return np.random.default_rng(seed).uniform(-side / 2, side / 2, (n, 3))


@pytest.mark.parametrize("side", [30.0, 150.0, 500.0])
def test_the_density_is_the_weighted_share_counted_candidate_by_candidate(side):
    candidates = scattered(600, side)
    is_object = (candidates[:, 0] > 0) & (np.arange(600) % 5 == 0)
    found = object_density(candidates, is_object)
    np.testing.assert_allclose(found, density_by_brute_force(candidates, is_object), atol=1e-9)


def test_the_density_rises_on_the_way_from_open_terrain_into_a_town():
    candidates = scattered(8000, 400.0)
    candidates[:, 1] *= 0.1
    is_object = (candidates[:, 0] > 0) & (np.arange(8000) % 3 == 0)
    density = object_density(candidates, is_object)
    assert (density[candidates[:, 0] < -80] == 0.0).all()
    assert (density[candidates[:, 0] > 20] > 0.2).all()
    middle = density[(candidates[:, 0] > -60) & (candidates[:, 0] < 0)]
    assert 0.01 < middle.mean() < 0.2


def test_the_order_of_candidates_does_not_matter():
    candidates = scattered(700, 300.0, seed=3)
    is_object = np.random.default_rng(1).random(700) < 0.1
    order = np.random.default_rng(2).permutation(700)
    plain, shuffled = (
        object_density(candidates, is_object),
        object_density(candidates[order], is_object[order]),
    )
    np.testing.assert_array_equal(shuffled, plain[order])
