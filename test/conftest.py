"""Fixtures that all tests share."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck
from hypothesis import settings as of_properties

# The same cases each time, on a busy machine, too; `bench/fuzz` looks for others.
of_properties.register_profile(
    "same", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
of_properties.load_profile("same")

#: Where the real clouds lie unless LIDAR_BUILDINGS_DATA says otherwise: beside the repository.
DEFAULT_DATA = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Folder of real lidar data; skips the test where it is absent."""
    folder = Path(os.environ.get("LIDAR_BUILDINGS_DATA", DEFAULT_DATA)).resolve()
    if not folder.is_dir():
        pytest.skip("real lidar data are absent: set LIDAR_BUILDINGS_DATA to their folder")
    return folder


@pytest.fixture
def context():
    """A context of ROS in a domain of this process's own."""
    import rclpy
    from support.ros_domain import use_own_domain

    from lidar_buildings.ros.middleware import prepare_middleware

    use_own_domain()
    prepare_middleware()
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    yield context
    rclpy.try_shutdown(context=context)


@pytest.fixture
def command(capfd):
    """The command line, called as users do."""
    from support.cli_runs import Command  # not every test needs it

    return Command(capfd)


@pytest.fixture(scope="session")
def house(tmp_path_factory) -> Path:
    """A survey of one house."""
    from lidar_buildings.simulation import simulate_survey

    folder = tmp_path_factory.mktemp("house")
    simulate_survey(folder, "single_house", 0, density=3.0)
    return folder


@pytest.fixture(scope="session")
def village(tmp_path_factory) -> Path:
    """A survey of a village, of one pulse a square metre."""
    from lidar_buildings.simulation import simulate_survey

    folder = tmp_path_factory.mktemp("village")
    simulate_survey(folder, "village", 1, density=1.0)
    return folder


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """
    Put files with slow tests first, and those that use dask last.

    A worker that gets a slow one last keeps the others waiting. Where dask was used a second thread stays:
    pools of processes are spawned from then on, which is slow, and does without what a test has replaced.
    """
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    dask = {item.path for item in items if item.get_closest_marker("cluster")}
    items.sort(key=lambda item: (item.path in dask, item.path not in slow))
