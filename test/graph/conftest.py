import os
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from lidar_buildings.simulation import simulate_survey


@pytest.fixture(scope="session", autouse=True)
def _own_domain():
    # Workers side by side must not hear each other; domains up to 101 have free ports.
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
    os.environ["ROS_DOMAIN_ID"] = str(70 + int(worker) % 30)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


@pytest.fixture(scope="session")
def survey(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("survey")
    simulate_survey(folder, "village", 1, density=1.0)
    return folder
