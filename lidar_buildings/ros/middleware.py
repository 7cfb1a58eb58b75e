"""What has to be set before ROS starts: memory for large clouds, and no limit to a topic's history."""

from __future__ import annotations

import ctypes
import os
import sys
from contextlib import suppress
from importlib import resources
from pathlib import Path

#: Fast DDS 2 (Jazzy) and Fast DDS 3 read different variables.
_PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_PROFILE = "fastdds_profile.xml"

# Parameters of mallopt, from malloc.h of glibc.
_M_TRIM_THRESHOLD, _M_MMAP_MAX, _M_ARENA_MAX = -1, -4, -8
_MAX_C_INT = 2**31 - 1


def prepare_middleware() -> None:
    """Tune malloc and lift the limits of Fast DDS; call it once, before ``rclpy.init``."""
    tune_malloc()
    use_profile()


def tune_malloc() -> None:
    """
    Keep freed memory instead of giving it back: pages fresh from the kernel make clouds several times slower.

    Does nothing where the C library is not glibc, or where the user has set it through the environment.
    """
    if not sys.platform.startswith("linux") or any(name.startswith("MALLOC_") for name in os.environ):
        return
    with suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_M_MMAP_MAX, 0)
        mallopt(_M_TRIM_THRESHOLD, _MAX_C_INT)
        mallopt(_M_ARENA_MAX, 1)


def use_profile() -> None:
    """
    Give Fast DDS our profile, unless the user has one.

    By default Fast DDS holds at most 5000 messages of a topic on each side, KEEP_ALL or not, and a tile can
    have more rings: a publisher in the same process then blocks for good, one in another process fails. The
    credits of the player bound what is under way, so no limit is needed here.
    """
    if any(os.environ.get(name) for name in _PROFILE_VARIABLES):
        return
    profile = resources.files("lidar_buildings.ros").joinpath(_PROFILE)
    if isinstance(profile, Path) and profile.is_file():
        for name in _PROFILE_VARIABLES:
            os.environ[name] = str(profile)
