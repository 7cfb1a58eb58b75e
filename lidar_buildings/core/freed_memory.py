"""Memory that was freed: kept for what comes next, or given back to the system."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

# Parameters of mallopt, from malloc.h of glibc.
_M_TRIM_THRESHOLD, _M_MMAP_MAX, _M_ARENA_MAX = -1, -4, -8
_MAX_C_INT = 2**31 - 1
#: New objects until Python looks for garbage, instead of some hundreds: arrays and shapes make next to none.
_NEW_OBJECTS = 50_000

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


@contextmanager
def rare_collection() -> Iterator[None]:
    """Let Python look for garbage seldom until the block ends: it took 2 % of a large run's time."""
    usual = gc.get_threshold()
    gc.set_threshold(_NEW_OBJECTS, *usual[1:])
    try:
        yield
    finally:
        gc.set_threshold(*usual)


def give_memory_back(period: float = 0.0) -> None:
    """
    Return to the system what is free: glibc keeps holes between what is in use, half a tile's memory.

    What is taken again comes fresh from the kernel, which costs time: nothing is done within `period` [s] of
    the last call that did so, nor without glibc.
    """
    global _last
    now = time.monotonic()
    if now - _last < period:
        return
    _last = now
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
