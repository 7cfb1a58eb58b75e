import numpy as np
import pytest

from lidar_buildings.core.stages.ground_filter.growing_tin.object_density import (
    BARE_SHARE,
    BUILT_SHARE,
    CELL,
    RADIUS,
    measure_bareness,
)


def bareness_by_brute_force(candidates, standing):
    """What `measure_bareness` returns, candidate by candidate."""
    cell = np.floor(candidates[:, :2] / CELL)
    bareness = np.empty(len(candidates))
    for i in range(len(candidates)):
        steps = cell - cell[i]
        weight = np.exp(-2 * (steps**2).sum(axis=1) / RADIUS**2) * (abs(steps) <= RADIUS).all(axis=1)
        share = weight @ standing / weight.sum()
        bareness[i] = np.clip((BUILT_SHARE - share) / (BUILT_SHARE - BARE_SHARE), 0, 1)
    return bareness


def scattered(n, side, seed=0):
    """Random points over a square about the origin."""
    return np.random.default_rng(seed).uniform(-side / 2, side / 2, (n, 3))


@pytest.mark.parametrize("side", [30.0, 150.0, 500.0])
def test_bareness_is_that_of_the_weighted_share_counted_candidate_by_candidate(side):
    candidates = scattered(600, side)
    standing = (candidates[:, 0] > 0) & (np.arange(600) % 5 == 0)
    found = measure_bareness(candidates, standing)
    np.testing.assert_allclose(found, bareness_by_brute_force(candidates, standing), atol=1e-9)


def test_land_without_objects_is_bare_and_a_town_is_not():
    candidates = scattered(500, 200.0)
    np.testing.assert_array_equal(measure_bareness(candidates, np.zeros(500, dtype=bool)), 1.0)
    np.testing.assert_array_equal(measure_bareness(candidates, np.ones(500, dtype=bool)), 0.0)
    np.testing.assert_array_equal(measure_bareness(candidates, np.arange(500) % 3 == 0), 0.0)


def test_bareness_falls_from_one_to_none_on_the_way_from_open_country_into_a_town():
    candidates = scattered(8000, 400.0)
    candidates[:, 1] *= 0.1
    standing = (candidates[:, 0] > 0) & (np.arange(8000) % 3 == 0)
    bareness = measure_bareness(candidates, standing)
    assert (bareness[candidates[:, 0] < -80] == 1.0).all()
    assert (bareness[candidates[:, 0] > 20] == 0.0).all()
    middle = bareness[(candidates[:, 0] > -60) & (candidates[:, 0] < 0)]
    assert 0.1 < middle.mean() < 0.9


def test_what_stands_beyond_the_reach_has_no_say():
    candidates = np.array([[5.0, 5.0, 0.0], [5.0 + CELL * (RADIUS + 1), 5.0, 0.0]])
    np.testing.assert_array_equal(measure_bareness(candidates, np.array([False, True])), [1.0, 0.0])
    candidates[1, 0] -= CELL
    # Now each has a weight of exp(−2) for the other: 12 % of what stands, or does not.
    share = np.exp(-2) / (1 + np.exp(-2))
    expected = [(BUILT_SHARE - share) / (BUILT_SHARE - BARE_SHARE), 0.0]
    np.testing.assert_allclose(measure_bareness(candidates, np.array([False, True])), expected)


def test_the_order_of_candidates_does_not_matter():
    candidates = scattered(700, 300.0, seed=3)
    standing = np.random.default_rng(1).random(700) < 0.1
    order = np.random.default_rng(2).permutation(700)
    plain, shuffled = (
        measure_bareness(candidates, standing),
        measure_bareness(candidates[order], standing[order]),
    )
    np.testing.assert_array_equal(shuffled, plain[order])


def test_a_tile_that_shows_all_that_has_a_say_gives_the_same_as_the_whole():
    candidates = scattered(4000, 500.0, seed=4)
    standing = np.random.default_rng(5).random(4000) < 0.1
    whole = measure_bareness(candidates, standing)
    tile = (abs(candidates[:, :2]) < 50.0 + CELL * (RADIUS + 1)).all(axis=1)
    core = (abs(candidates[tile, :2]) < 50.0).all(axis=1)
    cut = measure_bareness(candidates[tile], standing[tile])
    np.testing.assert_allclose(cut[core], whole[tile][core], atol=1e-12)


@pytest.mark.parametrize("standing", [False, True])
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
def test_few_or_odd_candidates_are_as_bare_as_what_they_are(candidates, standing):
    found = measure_bareness(np.array(candidates), np.full(len(candidates), standing))
    np.testing.assert_array_equal(found, 0.0 if standing else 1.0)
