"""A table of cells gives back what cells were given, and takes little memory for it."""

import tracemalloc

import numpy as np
import pytest

from lidar_buildings.io.tiling.tile_grid import CellTable

CELLS = [(0, 0), (-1, 15), (16, -17), (10**9, -(10**9))]


@pytest.mark.parametrize(("missing", "kind"), [(0, int), (-np.inf, float)])
def test_cells_have_the_numbers_that_they_were_given_last(missing, kind):
    table = CellTable(missing)
    for number, cell in enumerate([*CELLS, *CELLS[::-1]], start=1):
        table[cell] = kind(number)
    assert [table[cell] for cell in CELLS] == [8, 7, 6, 5]
    assert isinstance(table[CELLS[0]], kind)
    assert table[(1, 0)] == table[(5000, 5000)] == missing
    assert sorted(table) == sorted(CELLS)


def test_a_part_holds_the_numbers_of_its_cells_alone():
    table = CellTable(0)
    for number, cell in enumerate(CELLS, start=1):
        table[cell] = number
    part = table.part([CELLS[1], (7, 7)])
    assert list(part) == [CELLS[1]]
    table[CELLS[1]] = 9
    assert part[CELLS[1]] == 2


def test_a_cell_takes_some_bytes():
    table = CellTable(0)
    tracemalloc.start()
    for x in range(160):
        for y in range(160):
            table[x, y] = 1000 + x
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert taken < 12 * 160 * 160
