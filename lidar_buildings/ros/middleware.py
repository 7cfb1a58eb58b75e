"""What has to be set before ROS starts: memory for large clouds, how they travel, and how many are kept."""

from __future__ import annotations

import math
import os
from pathlib import Path

from lidar_buildings.core.freed_memory import tune_malloc

#: Fast DDS 2 (Jazzy) and Fast DDS 3 read different variables.
_PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_RANGE, _PEERS = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS"
#: For all ranges of discovery; in place of the range of this host alone.
_PROFILE, _LOCALHOST, _SCANS = "fastdds_profile", "fastdds_localhost", "_scans"

#: Least buffer of a socket with which clouds of a driver come through whole [bytes]; where Linux says what it
#: allows.
SOCKET_BUFFER = 4_194_304
_ALLOWED_BUFFER = Path("/proc/sys/net/core/rmem_max")


def prepare_middleware(*, carries_scans: bool = False) -> None:
    """
    Tune malloc, and give Fast DDS our profile and transport, unless the user has a profile.

    Call it once, before ``rclpy.init``. By default Fast DDS holds at most 5000 messages of a topic, KEEP_ALL
    or not: publishers of a tile with more rings block or fail. The player's credits bound what is under way.

    Its shared memory is not used: restarted nodes were at times deaf to others for good, containers often
    share no ``/dev/shm``, and most clouds of more than its 512 kB got lost. UDP with large buffers takes no
    longer. A process that sends or hears scans, of which none comes again, keeps shared memory where the
    system allows no such buffers, and others do not forget it for two minutes while it stands still. ROS's
    range ``LOCALHOST`` implies shared memory, so a profile takes its place.
    """
    tune_malloc()
    if any(os.environ.get(name) for name in _PROFILE_VARIABLES):
        return
    profile = _PROFILE
    if os.environ.get(_TRANSPORTS) is None and (not carries_scans or allowed_buffer() >= SOCKET_BUFFER):
        if os.environ.get(_RANGE) == "LOCALHOST" and not os.environ.get(_PEERS):
            os.environ[_RANGE], profile = "SYSTEM_DEFAULT", _LOCALHOST
        os.environ[_TRANSPORTS] = "UDPv4"
    name = f"{profile}{_SCANS if carries_scans else ''}.xml"
    os.environ.update(dict.fromkeys(_PROFILE_VARIABLES, str(Path(__file__).with_name(name))))


def allowed_buffer() -> float:
    """Return how large a socket's buffer may be [bytes], infinite where the system does not say."""
    try:
        return float(_ALLOWED_BUFFER.read_text())
    except (OSError, ValueError):
        return math.inf
