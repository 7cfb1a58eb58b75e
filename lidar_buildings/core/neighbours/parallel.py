"""
Work on rows in parallel with plain threads.

Numba's own threading layers are not used: where neither TBB nor OpenMP is installed its fallback ends the
process when two threads enter parallel code at once, which is what nodes in one process do.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

#: Rows a block: large enough to hide the hand-over, small enough to share out evenly.
BLOCK = 8192
_NAME = "row-blocks"
_thread = threading.local()
_are_cores_free: Callable[[], bool] = lambda: True  # noqa: E731
_lock = threading.Lock()
_pool: ThreadPoolExecutor | None = None


def work_alone() -> None:
    """Let the calling thread do all its blocks itself, since the other cores have work."""
    _thread.is_alone = True


def share_cores(are_free: Callable[[], bool]) -> None:
    """Let this process do blocks on several cores only as long as others leave them free."""
    global _are_cores_free
    _are_cores_free = are_free


def n_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def for_row_blocks(kernel: Callable[[int, int], object], n_rows: int, block: int = BLOCK) -> None:
    """
    Call ``kernel(first, last)`` for blocks of rows on all cores, and wait.

    It releases the interpreter lock and writes rows `first` to `last` (exclusive) of its outputs only, so
    that the result does not depend on the number of threads. Blocks are smaller where a row stands for much
    work.
    """
    starts = range(0, n_rows, block)
    is_alone = len(starts) < 2 or getattr(_thread, "is_alone", False) or not _are_cores_free()
    pool = None if is_alone else _threads()
    if pool is None:
        for first in starts:
            kernel(first, min(first + block, n_rows))
        return
    for done in [pool.submit(kernel, first, min(first + block, n_rows)) for first in starts]:
        done.result()


def _threads() -> ThreadPoolExecutor | None:
    """Return this process's threads; None on a single core."""
    global _pool
    with _lock:
        if _pool is None and n_cores() > 1:
            _pool = ThreadPoolExecutor(n_cores(), thread_name_prefix=_NAME, initializer=work_alone)
        return _pool


def is_single_thread() -> bool:
    """Whether no thread but this one is left in this process: those for rows, which only wait then, end."""
    global _pool
    others = {
        one.name.rpartition("_")[0] for one in threading.enumerate() if one.ident != threading.get_ident()
    }
    if others == {_NAME} and _pool is not None:
        _pool.shutdown()
        _pool, others = None, set()
    return not others


def _forget() -> None:
    """Start without threads after a fork, which takes none along."""
    global _pool, _lock
    _pool, _lock = None, threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
