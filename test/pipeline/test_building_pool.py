"""Buildings in processes: the same results as without, whatever happens to a process."""

import logging
import multiprocessing
import os
import signal
import threading
import time
import weakref
from pathlib import Path

import numpy as np
import pytest

from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.parallel import for_row_blocks, n_cores
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.pipeline.agenda import WorkerLostError
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.pipeline.tile_models import build_models
from lidar_buildings.pipeline.tile_stages import fit_planes

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


def tile(job, pool=None):
    """Do what a job says and share buildings, as what works on a whole tile does."""
    do(job)
    shared = [] if pool is None else pool.map(process_of, list(range(40)), [LARGE] * 40, lost)
    return [found for found, _ in shared], {process for _, process in shared}, os.getpid()


def wait(job):
    """Do nothing for long, in another process; nothing at all here."""
    if multiprocessing.current_process().name != "MainProcess":
        time.sleep(60.0)


def end_elsewhere():
    """End any process but this one."""
    if multiprocessing.current_process().name != "MainProcess":
        os._exit(9)
    return os.getpid()


def break_with_lock():
    error = ValueError("a lock of it")
    error.lock = threading.Lock()
    raise error


def threads_used(others):
    """Whether blocks are done by other threads while so many jobs are under way."""
    folder, n_others = others
    (folder / f"{os.getpid()}").touch()
    while len(list(folder.iterdir())) < n_others:
        time.sleep(0.001)
    used, own, has_other, waited = set(), threading.get_ident(), threading.Event(), []

    def block(first, last):
        used.add(threading.get_ident())
        if threading.get_ident() != own:
            has_other.set()
        elif not waited:  # else one thread may have done all before others wake
            waited.append(has_other.wait(1.0))

    for_row_blocks(block, 1000, 1)
    (folder / f"{os.getpid()} done").touch()
    while len(list(folder.glob("* done"))) < n_others:
        time.sleep(0.001)
    return used != {own}


def is_alive(process):
    """Whether a process has not ended; what nobody has asked for its exit code stays a zombie."""
    try:
        return "State:\tZ" not in Path(f"/proc/{process}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


def lost(job):
    return "lost"


@pytest.fixture(autouse=True)
def _forked(monkeypatch):
    """Fork whatever threads other tests have left, so that processes know this file's functions."""
    monkeypatch.setattr("threading.active_count", lambda: 1)
    monkeypatch.setattr("lidar_buildings.pipeline.pool_workers.n_waiting_threads", lambda: 0)


@pytest.fixture
def pool():
    with BuildingPool(2) as opened:
        yield opened


def test_results_come_in_the_order_of_the_jobs_from_other_processes(pool):
    sizes = [LARGE * (k % 5 + 1) for k in range(40)]
    found = pool.map(process_of, list(range(40)), sizes, lost)
    assert [job for job, _ in found] == list(range(40))
    assert os.getpid() not in {process for _, process in found}


def test_a_handful_of_small_buildings_stays_here(pool):
    assert pool.map(process_of, [1, 2], [10, 10], lost) == [(1, os.getpid()), (2, os.getpid())]


def test_one_core_has_no_processes():
    with BuildingPool(1) as alone:
        assert {process for _, process in alone.map(process_of, [1, 2], [LARGE] * 2, lost)} == {os.getpid()}


def test_a_process_that_ends_loses_nothing(pool, tmp_path):
    jobs = [1, ("end once", tmp_path / "ended"), *range(2, 30)]
    assert pool.map(do, jobs, [LARGE] * len(jobs), lost) == jobs
    assert pool.map(do, jobs, [LARGE] * len(jobs), lost) == jobs


def test_a_building_that_ends_every_process_is_given_up_and_the_others_are_done_here(pool):
    jobs = [1, ("end",), *range(2, 30)]
    expected = [1, "lost", *range(2, 30)]
    assert pool.map(do, jobs, [LARGE] * len(jobs), lost) == expected
    here = pool.map(process_of, [1, 2], [LARGE] * 2, lost)
    assert {process for _, process in here} == {os.getpid()}


def test_an_interrupt_ends_no_process(pool):
    jobs = ["interrupt", 1, 2]
    assert pool.map(do, jobs, [LARGE] * 3, lost) == jobs


def test_an_exception_arrives_with_its_words(pool):
    with pytest.raises(ValueError, match="a beam broke"):
        pool.map(do, ["raise", 1], [LARGE] * 2, lost)


def test_what_a_process_logs_is_logged_here(pool, caplog):
    pool.map(do, ["log", 1], [LARGE] * 2, lost)
    assert ("beams", logging.WARNING, "beam 3 bends") in caplog.record_tuples


def test_a_closed_pool_works_here(pool):
    pool.map(do, [1, 2], [LARGE] * 2, lost)
    pool.close()
    assert {process for _, process in pool.map(process_of, [1, 2], [LARGE] * 2, lost)} == {os.getpid()}


def test_a_tile_alone_shares_its_buildings_with_all_processes(pool):
    shared, processes, worker = pool.call(tile, 1, shares=True)
    assert shared == list(range(40))
    assert worker != os.getpid()
    assert worker in processes or len(processes) == 1
    assert os.getpid() not in processes


def test_tiles_that_share_at_the_same_time_get_their_own_results(pool):
    answers = [pool.submit(tile, k, shares=True) for k in range(12)]
    assert all(answer.result()[0] == list(range(40)) for answer in answers)


def test_without_processes_a_tile_is_done_here():
    with BuildingPool(1) as alone:
        assert alone.call(tile, 1, shares=True) == ([], set(), os.getpid())


def test_a_tile_whose_process_ends_is_done_by_another_one(pool, tmp_path):
    assert pool.call(tile, ("end once", tmp_path / "ended"), shares=True)[0] == list(range(40))


def test_a_tile_that_ends_two_processes_is_given_up_and_what_waits_is_done_here(pool):
    answers = [pool.submit(end_elsewhere) for _ in range(4)]
    given_up = [answer for answer in answers if isinstance(answer.exception(), WorkerLostError)]
    assert answers[0] in given_up
    assert {answer.result() for answer in answers if answer not in given_up} == {os.getpid()}
    assert pool.call(tile, 1, shares=True)[2] == os.getpid()


def test_what_goes_wrong_in_a_tile_arrives_with_its_words_and_its_place(pool):
    with pytest.raises(ValueError, match="a beam broke") as told:
        pool.call(tile, "raise", shares=True)
    assert "in do" in str(told.value.__cause__)


def test_of_what_goes_wrong_and_cannot_be_sent_the_words_arrive(pool):
    with pytest.raises(RuntimeError, match="a lock of it"):
        pool.call(break_with_lock)


def test_models_and_planes_are_the_same_with_and_without_processes(pool):
    random = np.random.default_rng(0)
    square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    n = 3000
    xy = random.uniform(0, 10, (4, n, 2))
    z = 8.0 - np.arange(1, 5)[:, None] * 0.1 * np.abs(xy[..., 0] - 5.0) + random.normal(0, 0.02, (4, n))
    points = np.concatenate([np.column_stack([xy[k] + [20.0 * k, 0.0], z[k]]) for k in range(4)])
    tile = PointTile(
        points,
        height_above_ground=points[:, 2] - 1.0,
        building_id=np.repeat(np.arange(1, 5), n).astype(np.uint32),
    )
    outlines = tuple(BuildingOutline(k + 1, Outline(square + np.array([20.0 * k, 0.0]))) for k in range(4))
    planes = [fit_planes(tile, PlaneFittingConfig(), each) for each in (None, pool)]
    assert planes[0].plane_id.any()
    assert np.array_equal(planes[0].plane_id, planes[1].plane_id)
    here, there = (build_models(planes[0], outlines, BuildingModelConfig(), each) for each in (None, pool))
    for one, other in zip(here, there, strict=True):
        assert one.attributes == other.attributes
        assert one.model.solids.keys() == other.model.solids.keys() == {"1.2", "1.3", "2.2"}
        for lod, solid in one.model.solids.items():
            assert solid.vertices.tobytes() == other.model.solids[lod].vertices.tobytes()
            assert solid.faces == other.model.solids[lod].faces


def test_the_first_process_prepares_for_all(tmp_path):
    made = tmp_path / "made"

    def prepare():
        with made.open("a") as file:
            file.write(f"{os.getpid()} ")

    with BuildingPool(3, prepare) as opened:
        found = opened.map(process_of, list(range(30)), [LARGE] * 30, lost)
    assert len(made.read_text().split()) == 1
    assert [job for job, _ in found] == list(range(30))


def test_what_goes_wrong_in_the_preparation_is_no_obstacle():
    def prepare():
        raise RuntimeError("no compiler")

    with BuildingPool(2, prepare) as opened:
        assert opened.map(do, list(range(10)), [LARGE] * 10, lost) == list(range(10))


def test_closing_ends_all_processes_though_they_are_at_work():
    with BuildingPool(3) as opened:
        at_work = {process for _, process in opened.map(process_of, list(range(30)), [LARGE] * 30, lost)}
        caller = threading.Thread(target=opened.map, args=(wait, [0, 1, 2], [LARGE] * 3, lost))
        caller.start()
    caller.join()
    while any(is_alive(process) for process in at_work):
        time.sleep(0.01)


def place_of(number, pool=None):
    return number, os.getpid(), pool is not None


def refuse(number):
    raise ValueError(f"number = {number}: must be larger")


def test_a_call_is_done_in_another_process_which_may_share_it():
    with BuildingPool(2) as pool:
        number, process, has_pool = pool.call(place_of, 5)
        assert (number, has_pool) == (5, False)
        assert process != os.getpid()
        assert pool.call(place_of, 6, shares=True)[::2] == (6, True)
        large = np.arange(60_000.0).reshape(20_000, 3)
        for sent in (large, large.T, large[::2], large[:0], large.astype(np.float32), large[:5]):
            come = pool.call(np.negative, sent)
            np.testing.assert_array_equal(come, -sent)
            come += 1  # not read-only
        with pytest.raises(ValueError, match="number = 7: must be larger"):
            pool.call(refuse, 7)
    assert pool.call(place_of, 8) == (8, os.getpid(), False)


@pytest.mark.parametrize("n_processes", [0, 2])
def test_a_call_says_when_it_is_done(n_processes):
    with BuildingPool(n_processes) as pool:
        good, bad = pool.submit(place_of, 5, shares=n_processes > 0), pool.submit(refuse, 7)
        for call in (good, bad):
            is_done = threading.Event()
            call.add_done_callback(lambda _, is_done=is_done: is_done.set())
            assert is_done.wait(20.0)
        assert good.result()[::2] == (5, n_processes > 0)
        with pytest.raises(ValueError, match="number = 7: must be larger"):
            bad.result()


@pytest.mark.skipif(n_cores() < 2, reason="a single core needs no threads")
def test_nothing_of_a_call_is_kept_when_it_is_done(pool):
    large, is_gone = np.ones(LARGE), threading.Event()
    weakref.finalize(large, is_gone.set)
    assert pool.call(np.sum, large) == LARGE
    del large
    assert is_gone.wait(20.0)


def test_a_process_uses_the_cores_that_others_leave_free(tmp_path):
    n = n_cores()
    alone, crowd = tmp_path / "alone", tmp_path / "crowd"
    alone.mkdir()
    crowd.mkdir()
    with BuildingPool(n) as pool:
        assert list(pool.call_each(threads_used, [(crowd, n)] * n)) == [False] * n
        assert pool.call(threads_used, (alone, 1))
