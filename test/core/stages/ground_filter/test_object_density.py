import numpy as np
import pytest

from lidar_buildings.core.stages.ground_filter.landforms import (
    CELL,
    RADIUS,
    object_density,
)


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


def test_objects_beyond_the_reach_do_not_count():
    candidates = np.array([[5.0, 5.0, 0.0], [5.0 + CELL * (RADIUS + 1), 5.0, 0.0]])
    np.testing.assert_array_equal(object_density(candidates, np.array([False, True])), [0.0, 1.0])
    candidates[1, 0] -= CELL
    # Now each has a weight of exp(−2) for the other.
    share = np.exp(-2) / (1 + np.exp(-2))
    np.testing.assert_allclose(object_density(candidates, np.array([False, True])), [share, 1.0 - share])


def test_the_order_of_candidates_does_not_matter():
    candidates = scattered(700, 300.0, seed=3)
    is_object = np.random.default_rng(1).random(700) < 0.1
    order = np.random.default_rng(2).permutation(700)
    plain, shuffled = (
        object_density(candidates, is_object),
        object_density(candidates[order], is_object[order]),
    )
    np.testing.assert_array_equal(shuffled, plain[order])


def test_a_tile_with_all_within_reach_gives_the_same_as_the_whole():
    candidates = scattered(4000, 500.0, seed=4)
    is_object = np.random.default_rng(5).random(4000) < 0.1
    whole = object_density(candidates, is_object)
    tile = (abs(candidates[:, :2]) < 50.0 + CELL * (RADIUS + 1)).all(axis=1)
    core = (abs(candidates[tile, :2]) < 50.0).all(axis=1)
    cut = object_density(candidates[tile], is_object[tile])
    np.testing.assert_allclose(cut[core], whole[tile][core], atol=1e-12)


@pytest.mark.parametrize("is_object", [False, True])
@pytest.mark.parametrize(
    "candidates",
    [
        [[1.0, 2.0, 3.0]],
        [[1.0, 2.0, 3.0], [-4.0, 5.0, 3.0]],
        [[7.0 * k, -3.0 * k, 0.0] for k in range(50)],
        [[2.0, 2.0, 1.0]] * 9,
        [[0.0, 0.0, 0.0], [1e9, -1e9, 0.0]],
    ],
    ids=["one", "two", "collinear", "identical", "huge"],
)
def test_few_or_odd_candidates_have_the_density_of_what_they_are(candidates, is_object):
    found = object_density(np.array(candidates), np.full(len(candidates), is_object))
    np.testing.assert_array_equal(found, 1.0 if is_object else 0.0)
