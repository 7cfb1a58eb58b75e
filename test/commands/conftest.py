import pytest

from lidar_buildings.commands.stage_calls import load_stages


@pytest.fixture(scope="session", autouse=True)
def _loaded():
    """Load compiled code once: the processes of each run are forked from this one."""
    load_stages()


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch):
    """
    Let runs do all in this process, where what a test replaces is seen.

    Runs of wider fixtures have a pool of processes: tests compare what both kinds give.
    """
    monkeypatch.setattr("lidar_buildings.pipeline.building_pool.n_cores", lambda: 1)
