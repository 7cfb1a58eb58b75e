"""Work on rows in blocks: by several threads, or by one that is told to work alone."""

import threading

import numpy as np

from lidar_buildings.core.neighbours import parallel
from lidar_buildings.core.neighbours.parallel import for_row_blocks, is_single_thread, work_alone


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


def test_a_thread_that_works_alone_does_all_blocks_itself(monkeypatch):
    monkeypatch.setattr(parallel, "n_cores", lambda: 2)
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


def test_cores_that_others_need_or_that_there_are_not_are_left_alone(monkeypatch):
    monkeypatch.setattr(parallel, "_pool", None)
    monkeypatch.setattr(parallel, "n_cores", lambda: 1)
    assert work_on(100, 8)[1] == {threading.current_thread()}
    monkeypatch.setattr(parallel, "n_cores", lambda: 2)
    free = [True, False]
    monkeypatch.setattr(parallel, "_are_cores_free", free.pop)
    times, threads = work_on(100, 8)
    assert (times == 1).all()
    assert threads == {threading.current_thread()}
    assert threading.current_thread() not in work_on(100, 8)[1]


def test_threads_are_made_once_and_anew_after_a_fork(monkeypatch):
    monkeypatch.setattr(parallel, "_pool", None)
    monkeypatch.setattr(parallel, "n_cores", lambda: 2)
    _, first = work_on(100, 8)
    _, second = work_on(100, 8)
    assert len(first | second) <= 2
    parallel._forget()
    _, third = work_on(100, 8)
    assert not third & (first | second)


def test_blocks_within_a_block_do_not_wait_for_each_other():
    inner = []
    for_row_blocks(lambda first, last: inner.append(work_on(100, 8)[0]), 100, 8)
    assert all((times == 1).all() for times in inner)
    assert len(inner) == 13


def test_threads_that_only_wait_end_so_that_a_process_may_be_forked(monkeypatch):
    monkeypatch.setattr(parallel, "_pool", None)
    monkeypatch.setattr(parallel, "n_cores", lambda: 2)
    monkeypatch.setattr(threading, "enumerate", lambda: [threading.current_thread(), *started])
    started = work_on(100, 8)[1]
    assert is_single_thread()
    assert not any(one.is_alive() for one in started)
    started = work_on(100, 8)[1] | {threading.Thread(name="of others")}
    assert not is_single_thread()
    assert (work_on(100, 8)[0] == 1).all()
