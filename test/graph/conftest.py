from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from support.ros_domain import use_own_domain

from lidar_buildings.commands.stage_calls import load_stages


@pytest.fixture(scope="session", autouse=True)
def _own_domain():
    use_own_domain()


@pytest.fixture(scope="session", autouse=True)
def _loaded():
    """Load compiled code once: the processes of each run are forked from this one."""
    load_stages()


@pytest.fixture(scope="session")
def survey(village) -> Path:
    return village
