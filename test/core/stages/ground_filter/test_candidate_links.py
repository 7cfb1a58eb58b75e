import numpy as np
import pytest

from lidar_buildings.core.neighbours.sectors import N_SECTORS
from lidar_buildings.core.stages.ground_filter.landforms import (
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
