import numpy as np
import pytest

from lidar_buildings.core.neighbours.windows import first_windows, move_windows, z_range


def occupied_cells(n_columns, n_rows, share, seed=0):
    """Return the numbers of the cells that are occupied, rising."""
    return np.flatnonzero(np.random.default_rng(seed).uniform(size=n_columns * n_rows) < share)


def expected_window(numbers, n_columns, reach, cell):
    """Return the occupied cells in the square about one, by comparing all."""
    row, column = np.divmod(numbers, n_columns)
    near = (abs(row - row[cell]) <= reach) & (abs(column - column[cell]) <= reach)
    return np.flatnonzero(near).tolist()


def cells_of(windows):
    return [cell for begin, end in windows for cell in range(begin, end)]


@pytest.mark.parametrize("reach", [1, 2, 3])
@pytest.mark.parametrize(("n_columns", "share"), [(1, 1.0), (3, 0.6), (17, 0.1), (17, 0.9)])
def test_a_window_holds_the_occupied_cells_around_and_none_beyond_the_border(n_columns, share, reach):
    numbers = occupied_cells(n_columns, 12, share)
    windows = first_windows(numbers, n_columns, reach, 0)
    for cell in range(len(numbers)):
        move_windows(numbers, n_columns, reach, cell, windows)
        expected = expected_window(numbers, n_columns, reach, cell)
        assert cells_of(windows) == expected
        assert cells_of(first_windows(numbers, n_columns, reach, cell)) == expected


@pytest.mark.parametrize(("low", "high"), [(-1, 9), (2, 4), (1.5, 4.5), (7, 9), (-3, -1), (3, 3), (5, 5)])
def test_a_z_range_is_inclusive_at_both_ends(low, high):
    z = np.array([99.0, 0.0, 1.0, 2.0, 3.0, 3.0, 4.0, 6.0, 99.0])
    start, stop = z_range(z, 1, 8, low, high)
    inside = z[1:8][(z[1:8] >= low) & (z[1:8] <= high)]
    assert z[start:stop].tolist() == inside.tolist()
