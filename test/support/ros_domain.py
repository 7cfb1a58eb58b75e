"""A ROS domain for each test worker, so that workers side by side do not hear each other."""

import os

#: Domains up to 101 have free ports on every system.
_FIRST, _COUNT = 20, 50


def use_own_domain() -> None:
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
    os.environ["ROS_DOMAIN_ID"] = str(_FIRST + int(worker) % _COUNT)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
