"""Work on rows in blocks: by several threads, or by one that is told to work alone."""

import threading

import numpy as np

from lidar_buildings.core.neighbours.parallel import for_row_blocks, work_alone


def work_on(n_rows, block):
    """How often each row was worked on, and by which threads."""
    times, threads = np.zeros(n_rows, dtype=int), set()

    def kernel(first, last):
        times[first:last] += 1
        threads.add(threading.current_thread())

    for_row_blocks(kernel, n_rows, block)
    return times, threads


def test_every_row_is_worked_on_once():
    for n_rows in (0, 1, 7, 8, 9, 100):
        times, _ = work_on(n_rows, 8)
        assert (times == 1).all()


def test_a_thread_that_works_alone_does_all_blocks_itself():
    found = []

    def alone():
        work_alone()
        found.append(work_on(100, 8))

    thread = threading.Thread(target=alone)
    thread.start()
    thread.join()
    times, threads = found[0]
    assert (times == 1).all()
    assert threads == {thread}
    assert threading.current_thread() not in work_on(100, 8)[1]
