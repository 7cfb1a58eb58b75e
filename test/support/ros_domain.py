"""A ROS domain for each test process of a machine, so that those side by side do not hear each other."""

import fcntl
import os
import tempfile

from lidar_buildings.ros.middleware import prepare_middleware

#: Domains up to 101 have free ports on every system.
_DOMAINS = range(101, 19, -1)
#: What a process sets by `prepare_middleware`, and hands on to those that it starts.
OF_PROFILES = (
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "FASTDDS_BUILTIN_TRANSPORTS",
)
#: Held as long as the process lives.
_locks = []


def use_own_domain() -> None:
    """
    Take a domain that no other test process has, and set Fast DDS up as the package does.

    Fast DDS reads its profile when a process first uses it: a test that did without would leave its settings
    to those that come after it in the same process.
    """
    if _locks:
        return
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    for domain in _DOMAINS:
        lock = open(os.path.join(tempfile.gettempdir(), f"ros_domain_{domain}.lock"), "a")  # noqa: SIM115
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        _locks.append(lock)
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        prepare_middleware()
        return
    raise RuntimeError("every ROS domain is taken by another test process")
