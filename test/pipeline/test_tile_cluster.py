"""Work handed to dask's workers: done once whatever dies, refused where it cannot be done right."""

import os
import random
from pathlib import Path

import pytest

pytest.importorskip("distributed")
import support
from distributed import KilledWorker
from support.cluster_jobs import end, fail, process_of, twice, wait_for
from support.waiting import wait_until

from bench.scale.cluster import Cluster
from lidar_buildings.pipeline import tile_cluster
from lidar_buildings.pipeline.tile_cluster import ClusterError, TileCluster

pytestmark = pytest.mark.cluster


SUPPORT = Path(support.__path__[0]).parent


@pytest.fixture(scope="module")
def local():
    with TileCluster(n_workers=2) as cluster:
        yield cluster


def test_work_is_done_by_other_processes(local):
    answers = [local.submit(process_of, job) for job in range(8)]
    results = [answer.result(240.0) for answer in answers]
    assert [job for job, _ in results] == list(range(8))
    assert os.getpid() not in {process for _, process in results}
    assert list(local.map(twice, [1, 2, 3])) == [2, 4, 6]


def test_an_exception_comes_back(local):
    with pytest.raises(ValueError, match="a beam broke"):
        local.submit(fail, "a beam").result(240.0)


@pytest.mark.slow
def test_what_ends_its_workers_is_given_up_and_the_rest_is_done(local):
    bad = local.submit(end, None)
    good = [local.submit(process_of, job) for job in range(20)]
    assert [answer.result(240.0)[0] for answer in good] == list(range(20))
    with pytest.raises(KilledWorker):
        bad.result(240.0)
    assert local.submit(process_of, "after").result(240.0)[0] == "after"


def test_workers_of_another_version_are_refused_with_both(local, monkeypatch):
    monkeypatch.setattr(tile_cluster, "__version__", "9.8.7")
    with pytest.raises(
        ClusterError, match=r"tcp://\S+ has lidar_buildings \d+\.\d+\.\d+, and this is 9\.8\.7"
    ):
        TileCluster(scheduler=local._local.scheduler_address)


def test_a_scheduler_that_cannot_be_reached_gives_one_line(monkeypatch):
    monkeypatch.setattr(tile_cluster, "_AT_START", 0.5)
    for address in ("tcp://127.0.0.1:1", "nowhere at all"):
        with pytest.raises(ClusterError, match=r"no scheduler with workers can be reached") as refused:
            TileCluster(scheduler=address)
        assert "\n" not in str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize("share_of_scheduler", [0.0, 1.0], ids=["worker", "scheduler"])
def test_work_survives_the_end_of_what_does_it(share_of_scheduler, tmp_path, monkeypatch):
    """Both are started anew by what keeps services running."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(SUPPORT), os.environ.get("PYTHONPATH", "")]))
    with Cluster(1) as services, TileCluster(scheduler=services.address) as cluster:
        began, awaited = tmp_path / "began", tmp_path / "awaited"
        answer = cluster.submit(wait_for, (began, awaited))
        others = [cluster.submit(process_of, job) for job in range(3)]
        wait_until(began.exists)
        services.kill(random.Random(0), share_of_scheduler)
        awaited.touch()
        assert answer.result(240.0) == "done"
        assert [other.result(240.0)[0] for other in others] == [0, 1, 2]


def test_a_scheduler_that_does_not_return_ends_the_work_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(SUPPORT), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setattr(tile_cluster, "_MOST_TRIES", 1)
    services = Cluster(1)
    with services, TileCluster(scheduler=services.address) as cluster:
        began, awaited = tmp_path / "began", tmp_path / "awaited"
        monkeypatch.setattr(tile_cluster, "_AT_START", 0.5)
        answer = cluster.submit(wait_for, (began, awaited))
        services.stop()
        with pytest.raises(ClusterError, match="no scheduler with workers can be reached"):
            answer.result(240.0)
