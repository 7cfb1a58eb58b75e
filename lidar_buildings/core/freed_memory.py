"""Memory that was freed: kept for what comes next, or given back to the system."""

from __future__ import annotations

import ctypes
import os
import sys
import time
from contextlib import suppress

# Parameters of mallopt, from malloc.h of glibc.
_M_TRIM_THRESHOLD, _M_MMAP_MAX, _M_ARENA_MAX = -1, -4, -8
_MAX_C_INT = 2**31 - 1

_last = -float("inf")


def keep_freed_memory() -> None:
    """
    Let this process keep what it frees: pages fresh from the kernel make clouds several times slower.

    Does nothing where the C library is not glibc.
    """
    if not sys.platform.startswith("linux"):
        return
    with suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_M_MMAP_MAX, 0)
        mallopt(_M_TRIM_THRESHOLD, _MAX_C_INT)
        mallopt(_M_ARENA_MAX, 1)


def tune_malloc() -> None:
    """Keep freed memory, unless the user has told malloc what to do through the environment."""
    if not any(name.startswith("MALLOC_") for name in os.environ):
        keep_freed_memory()


def give_memory_back(period: float = 0.0) -> None:
    """
    Return free memory to the system, where there is glibc, which keeps holes of half a tile's memory.

    Does nothing within `period` [s] of the last call that did: fresh memory costs time.
    """
    global _last
    now = time.monotonic()
    if now - _last < period:
        return
    _last = now
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
