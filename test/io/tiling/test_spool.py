"""The spool gives the records of a cell back as they came."""

import threading
from contextlib import suppress
from itertools import count

import numpy as np

from lidar_buildings.io.tiling.spool import RECORD, Spool


def test_the_spool_gives_back_what_it_took_in_order(tmp_path):
    spool = Spool(tmp_path)
    random = np.random.default_rng(0)
    cells = random.integers(-40_000, 40_000, (3, 200, 2)) // 20_000
    records = np.zeros((3, 200), RECORD)
    records["index"] = np.arange(600).reshape(3, 200)
    for step in range(3):
        spool.append(cells[step], records[step])
    flat = cells.reshape(-1, 2)
    for cell in {tuple(c) for c in flat.tolist()}:
        found = np.concatenate(list(spool.blocks(cell)))["index"]
        assert found.tolist() == np.flatnonzero((flat == cell).all(axis=1)).tolist()
        assert spool.count(cell) == len(found)
    spool.remove()
    assert list(tmp_path.iterdir()) == []


def test_far_apart_cells_are_grouped_as_well(tmp_path):
    spool = Spool(tmp_path)
    cells = np.array([[0, 0], [10**9, -(10**9)], [0, 0]])
    records = np.zeros(3, RECORD)
    records["index"] = [1, 2, 3]
    assert sorted(spool.append(cells, records)) == [(0, 0), (10**9, -(10**9))]
    assert [r["index"].tolist() for r in spool.blocks((0, 0))] == [[1, 3]]


def test_nothing_is_left_of_a_spool_to_which_another_thread_still_adds(tmp_path):
    for _ in range(20):
        spool, is_adding, is_over = Spool(tmp_path), threading.Event(), threading.Event()

        def add(folder=spool.folder, begin=is_adding.set, is_over=is_over.is_set):
            numbers = count()
            with suppress(OSError):
                while not is_over():
                    (folder / str(next(numbers))).touch()
                    begin()

        adder = threading.Thread(target=add)
        adder.start()
        assert is_adding.wait(240.0)
        spool.remove()
        is_gone = not spool.folder.exists()
        is_over.set()
        adder.join()
        assert is_gone
        assert list(tmp_path.iterdir()) == []
