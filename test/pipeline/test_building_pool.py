"""Buildings in processes: the same results as without, whatever happens to a process."""

import logging
import multiprocessing
import os
import signal
import threading
import time
from functools import partial
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import numpy as np
import pytest
from support.waiting import wait_until

from lidar_buildings.core.neighbours.parallel import for_row_blocks, n_cores
from lidar_buildings.pipeline import building_pool
from lidar_buildings.pipeline.building_pool import BuildingPool, WorkerLostError, map_buildings

LARGE = 10_000


def process_of(job):
    return job, os.getpid()


def do(job):
    """Do what a job says, in whatever process."""
    if job == "raise":
        raise ValueError("a beam broke")
    if job == "log":
        logging.getLogger("beams").warning("beam %d bends", 3)
    if job == "interrupt":
        os.kill(os.getpid(), signal.SIGINT)
    if isinstance(job, tuple):
        if job[0] == "end":
            os._exit(9)
        if job[0] == "end once" and not job[1].exists():
            job[1].touch()
            os._exit(9)
    return job


def shared(pool, function, jobs, sizes=None):
    calls = [(k, partial(function, job)) for k, job in enumerate(jobs)]
    return map_buildings(pool, calls, sizes or [LARGE] * len(jobs), lambda _, reason: reason, "no beam")


def wait(job):
    """Do nothing for long, in another process; nothing at all here."""
    if multiprocessing.current_process().name != "MainProcess":
        time.sleep(60.0)


def threads_used(others):
    """Whether blocks are done by other threads while so many jobs are under way."""
    folder, n_others = others
    (folder / f"{os.getpid()}").touch()
    while len(list(folder.iterdir())) < n_others:
        time.sleep(0.001)
    used = set()
    for_row_blocks(lambda first, last: used.add(threading.get_ident()), 1000, 1)
    (folder / f"{os.getpid()} done").touch()
    while len(list(folder.glob("* done"))) < n_others:
        time.sleep(0.001)
    return used != {threading.get_ident()}


def is_alive(process):
    """Whether a process has not ended; what nobody has asked for its exit code stays a zombie."""
    try:
        return "State:\tZ" not in Path(f"/proc/{process}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.fixture(autouse=True)
def _forked(monkeypatch):
    """Fork, whatever threads other tests have left, so that processes know this file's functions."""
    start = building_pool._Worker.start
    monkeypatch.setattr(building_pool._Worker, "start", lambda self, method: start(self, "fork"))


@pytest.fixture
def pool():
    with BuildingPool(2) as opened:
        yield opened


def test_results_come_in_the_order_of_the_jobs_from_other_processes(pool):
    found = shared(pool, process_of, list(range(40)), [LARGE * (k % 5 + 1) for k in range(40)])
    assert [job for job, _ in found] == list(range(40))
    assert os.getpid() not in {process for _, process in found}


def test_a_handful_of_small_buildings_stays_here(pool):
    assert shared(pool, process_of, [1, 2], [10, 10]) == [(1, os.getpid()), (2, os.getpid())]


def test_a_process_that_ends_loses_nothing(pool, tmp_path):
    jobs = [1, ("end once", tmp_path / "ended"), *range(2, 30)]
    assert shared(pool, do, jobs) == jobs
    assert shared(pool, do, jobs) == jobs


def test_a_building_that_ends_two_processes_is_given_up_and_the_others_are_done(pool):
    jobs = [1, ("end",), *range(2, 30)]
    assert shared(pool, do, jobs) == [1, "two processes ended at it", *range(2, 30)]
    assert os.getpid() not in {process for _, process in shared(pool, process_of, [1, 2])}


def test_an_interrupt_ends_no_process(pool):
    assert shared(pool, do, ["interrupt", 1, 2]) == ["interrupt", 1, 2]


def test_what_a_process_logs_is_logged_here(pool, caplog):
    shared(pool, do, ["log", 1])
    assert ("beams", logging.WARNING, "beam 3 bends") in caplog.record_tuples


def test_a_closed_pool_works_here(pool):
    shared(pool, do, [1, 2])
    pool.close()
    assert {process for _, process in shared(pool, process_of, [1, 2])} == {os.getpid()}


def test_tiles_that_share_at_the_same_time_get_their_own_results(pool):
    def share(number):
        answers[number] = shared(pool, process_of, list(range(number, number + 40)))

    answers = {}
    threads = [threading.Thread(target=share, args=(number,)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for number, found in answers.items():
        assert [job for job, _ in found] == list(range(number, number + 40))


def test_a_tile_that_ends_two_processes_is_given_up_and_the_rest_is_done(pool):
    answers = [pool.submit(do, job) for job in (("end",), 1, 2, 3)]
    with pytest.raises(WorkerLostError, match="two processes ended at it"):
        answers[0].result()
    assert [answer.result() for answer in answers[1:]] == [1, 2, 3]


def test_a_process_that_was_killed_is_replaced_though_there_are_threads(monkeypatch):
    monkeypatch.undo()
    with BuildingPool(2) as pool:
        process = pool.submit(os.getpid).result()
        os.kill(process, signal.SIGKILL)
        others = {pool.submit(os.getpid).result() for _ in range(4)}
        assert process not in others
        assert os.getpid() not in others


def test_no_shared_memory_is_left_by_a_process_that_ends(pool, monkeypatch):
    made, packed = [], building_pool._packed  # other processes of the machine have memory of their own
    monkeypatch.setattr(building_pool, "_packed", lambda sent: made.append(packed(sent)) or made[-1])
    with pytest.raises(WorkerLostError):
        pool.submit(end_with, np.ones(LARGE * 10)).result()
    assert len(made) == 2
    for one in made:
        with pytest.raises(FileNotFoundError):
            SharedMemory(one.memory)


def test_processes_end_with_the_one_that_started_them(tmp_path):
    told = tmp_path / "processes"
    ended = multiprocessing.get_context("fork").Process(target=open_and_end, args=(told,))
    ended.start()
    ended.join()
    processes = [int(one) for one in told.read_text().split()]
    assert len(set(processes)) == 2
    wait_until(lambda: not any(is_alive(process) for process in processes))


def open_and_end(told):
    """Be killed with a pool open."""
    pool = BuildingPool(2)
    pids = {pool.submit(os.getpid).result() for _ in range(50)} | {one._pid.result() for one in pool._workers}
    told.write_text(" ".join(map(str, pids)))
    os.kill(os.getpid(), signal.SIGKILL)


def end_with(array):
    os._exit(9)


def test_closing_ends_all_processes_though_they_are_at_work():
    with BuildingPool(3) as opened:
        at_work = {process for _, process in shared(opened, process_of, list(range(30)))}
        answers = [opened.submit(wait, job) for job in range(5)]
    assert all(answer.done() for answer in answers)
    wait_until(lambda: not any(is_alive(process) for process in at_work))


def refuse(number):
    raise ValueError(f"number = {number}: must be larger")


def test_a_call_is_done_in_another_process_and_arrays_arrive_as_they_were():
    with BuildingPool(2) as pool:
        assert pool.submit(process_of, 5).result()[1] != os.getpid()
        large = np.arange(60_000.0).reshape(20_000, 3)
        for sent in (large, large.T, large[::2], large[:0], large.astype(np.float32), large[:5]):
            come = pool.submit(np.negative, sent).result()
            np.testing.assert_array_equal(come, -sent)
            come += 1  # not read-only
        with pytest.raises(ValueError, match="number = 7: must be larger"):
            pool.submit(refuse, 7).result()
        assert list(pool.map(do, [1, 2, 3])) == [1, 2, 3]
    assert pool.submit(process_of, 8).result() == (8, os.getpid())


def test_where_shared_memory_is_small_arrays_go_without(pool, monkeypatch):
    monkeypatch.setattr(building_pool, "_has_room", lambda size: False)
    np.testing.assert_array_equal(pool.submit(np.negative, np.arange(100_000)).result(), -np.arange(100_000))


def test_a_process_uses_the_cores_that_others_leave_free(tmp_path):
    n = n_cores()
    alone, crowd = tmp_path / "alone", tmp_path / "crowd"
    alone.mkdir()
    crowd.mkdir()
    with BuildingPool(n) as pool:
        assert list(pool.map(threads_used, [(crowd, n)] * n)) == [False] * n
        assert pool.submit(threads_used, (alone, 1)).result()
