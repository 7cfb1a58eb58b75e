"""Memory that was freed, back to the system."""

from __future__ import annotations

import ctypes
import time

_last = -float("inf")


def give_memory_back(period: float = 0.0) -> None:
    """
    Return to the system what is free: glibc keeps holes between what is in use, half a tile's memory.

    What is taken again comes fresh from the kernel, which costs time. Does nothing without glibc.

    Parameters
    ----------
    period : float
        Least time since the last call of this process that did so [s].
    """
    global _last
    now = time.monotonic()
    if now - _last < period:
        return
    _last = now
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
