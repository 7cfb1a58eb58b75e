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
_thread = threading.local()


def work_alone() -> None:
    """Let the calling thread do all its blocks itself: the other cores have threads of their own."""
    _thread.is_alone = True


def for_row_blocks(kernel: Callable[[int, int], object], n_rows: int, block: int = BLOCK) -> None:
    """
    Call ``kernel(first, last)`` for blocks of rows on all cores, and wait.

    Parameters
    ----------
    kernel : callable
        Releases the interpreter lock and writes rows `first` to `last` (exclusive) of its outputs only, so
        that the result does not depend on the number of threads.
    n_rows : int
        Number of rows in all.
    block : int
        Rows a block; fewer where a row stands for much work.
    """
    starts = range(0, n_rows, block)
    if len(starts) <= 1 or getattr(_thread, "is_alone", False):
        for first in starts:
            kernel(first, min(first + block, n_rows))
        return
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        for done in [pool.submit(kernel, first, min(first + block, n_rows)) for first in starts]:
            done.result()
