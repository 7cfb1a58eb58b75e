import pytest

from lidar_buildings.commands.stage_calls import load_stages


@pytest.fixture(scope="session", autouse=True)
def _loaded():
    """Load compiled code once: the processes of each run are forked from this one."""
    load_stages()
