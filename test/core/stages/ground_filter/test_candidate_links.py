import numpy as np
import pytest

from lidar_buildings.core.neighbours.sectors import N_SECTORS
from lidar_buildings.core.stages.ground_filter.landforms import (
    ROWS_A_BLOCK,
    nearest_by_sector,
)


def nearest_by_brute_force(candidates, rows, reach):
    """What `nearest_by_sector` returns, by looking at every pair."""
    found = np.full((len(rows), N_SECTORS), -1)
    for r, row in enumerate(rows):
        dx, dy = (candidates[:, :2] - candidates[row, :2]).T
        away = np.hypot(dx, dy)
        sector = np.floor(np.arctan2(dy, dx) % (2 * np.pi) / (2 * np.pi) * N_SECTORS).astype(int) % N_SECTORS
        for s in range(N_SECTORS):
            those = np.flatnonzero((sector == s) & (away > 0) & (away <= reach))
            if len(those):
                found[r, s] = those[np.argmin(away[those])]
    return found


def scattered(n, seed=0, side=40.0):
    """Random points over a square about the origin."""
    return np.random.default_rng(seed).uniform(-side / 2, side / 2, (n, 3))


@pytest.mark.parametrize(("n", "reach"), [(300, 3.0), (300, 0.5), (300, 100.0), (30, 8.0)])
def test_neighbours_are_those_that_looking_at_every_pair_finds(n, reach):
    candidates = scattered(n, seed=n)
    rows = np.arange(n)
    found = nearest_by_sector(candidates, rows, reach)
    np.testing.assert_array_equal(found, nearest_by_brute_force(candidates, rows, reach))


def test_only_the_rows_asked_for_are_answered_but_all_candidates_are_neighbours():
    candidates = scattered(400, seed=5)
    rows = np.array([399, 7, 7, 120])
    found = nearest_by_sector(candidates, rows, 4.0)
    np.testing.assert_array_equal(found, nearest_by_brute_force(candidates, rows, 4.0))
    assert not np.isin(found[found >= 0], rows).all()


def test_more_rows_than_a_block_of_work_are_answered_alike():
    candidates = scattered(2 * ROWS_A_BLOCK + 100, seed=2, side=90.0)
    rows = np.arange(len(candidates))
    found = nearest_by_sector(candidates, rows, 3.0)
    some = rows[ROWS_A_BLOCK - 50 : ROWS_A_BLOCK + 50]
    np.testing.assert_array_equal(found[some], nearest_by_brute_force(candidates, some, 3.0))


def test_the_order_of_candidates_does_not_matter():
    candidates = scattered(500, seed=4)
    order = np.random.default_rng(0).permutation(500)
    plain = nearest_by_sector(candidates, np.arange(500), 4.0)
    shuffled = nearest_by_sector(candidates[order], np.argsort(order), 4.0)
    np.testing.assert_array_equal(np.where(shuffled < 0, -1, order[shuffled]), plain)


def test_height_does_not_decide_who_is_next():
    candidates = scattered(200, seed=6)
    higher = candidates * [1, 1, 1000.0]
    rows = np.arange(200)
    np.testing.assert_array_equal(
        nearest_by_sector(candidates, rows, 5.0), nearest_by_sector(higher, rows, 5.0)
    )


def test_a_row_of_cells_does_not_go_on_at_its_other_end():
    # Cells are numbered row by row: the last of one row and the first of the next have following numbers.
    candidates = np.array([[0.5, 1.5, 0.0], [9.5, 0.5, 0.0], [9.5, 2.5, 0.0]])
    found = nearest_by_sector(candidates, np.arange(3), 1.0)
    assert (found == -1).all()


def test_neighbours_are_found_where_one_stray_is_enormously_far_off():
    candidates = np.vstack((scattered(100, seed=8), [[3e9, -2e9, 0.0]]))
    rows = np.arange(101)
    found = nearest_by_sector(candidates, rows, 6.0)
    np.testing.assert_array_equal(found, nearest_by_brute_force(candidates, rows, 6.0))


@pytest.mark.parametrize("n", [0, 1])
def test_none_and_one_alone_have_no_neighbours(n):
    found = nearest_by_sector(np.zeros((n, 3)), np.arange(n), 1.0)
    np.testing.assert_array_equal(found, np.full((n, N_SECTORS), -1))


def test_two_are_each_other_s_only_neighbours():
    found = nearest_by_sector(np.array([[0.0, 0.0, 0.0], [0.3, 0.4, 9.0]]), np.arange(2), 0.6)
    assert sorted(found[0]) == [-1] * 7 + [1]
    assert sorted(found[1]) == [-1] * 7 + [0]


def test_those_on_a_line_have_a_neighbour_ahead_and_one_behind():
    candidates = np.column_stack((np.arange(20.0), 0.3 * np.arange(20.0), np.zeros(20)))
    found = nearest_by_sector(candidates, np.arange(20), 2.5)
    for i in range(1, 19):
        assert sorted(found[i][found[i] >= 0]) == [i - 1, i + 1]


def test_others_at_the_same_place_are_no_neighbours():
    assert (nearest_by_sector(np.ones((5, 3)), np.arange(5), 1.0) == -1).all()
