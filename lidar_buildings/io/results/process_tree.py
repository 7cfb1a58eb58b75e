"""What a process and all that descend from it take, from the kernel's accounts."""

from __future__ import annotations

import os
import resource
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_PROC = Path("/proc")
_TICKS = os.sysconf("SC_CLK_TCK")
#: How often memory is looked at: a tile takes seconds, a look milliseconds [s].
_PERIOD = 0.5
#: Unit of the kernel's mark of the memory of a process [bytes].
_KIBI = 1024
#: The most that this process and those that descend from it have been seen to take [bytes].
_seen = [0]


def tree_of(pid: int) -> list[int]:
    """Return a process and its living descendants."""
    found = [pid]
    for one in found:
        with suppress(OSError):
            for task in (_PROC / str(one) / "task").iterdir():
                found += map(int, (task / "children").read_text().split())
    return found


def tree_memory(pid: int) -> int:
    """Return the memory of a tree, what several of its processes share counted once [bytes]."""
    return sum(memory_by_process(pid).values())


def memory_by_process(pid: int) -> dict[int, int]:
    """Return the memory of each process of a tree that lives, see `tree_memory` [bytes]."""
    found: dict[int, int] = {}
    for one in tree_of(pid):
        with suppress(OSError, StopIteration):
            lines = (_PROC / str(one) / "smaps_rollup").read_text().splitlines()
            found[one] = 1024 * next(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return found


def _resident_pages(pid: int) -> int:
    """Return the pages in memory of a tree, what several of its processes share counted for each."""
    found = 0
    for one in tree_of(pid):
        with suppress(OSError):
            found += int((_PROC / str(one) / "statm").read_text().split()[1])
    return found


def cpu_of(pids: list[int]) -> float:
    """Return the processor time of living processes, and of children that they waited for, so far [s]."""
    total = 0
    for pid in pids:
        with suppress(OSError):
            fields = (_PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()
            total += sum(map(int, fields[11:15]))
    return total / _TICKS


class MemoryWatch:
    """
    The most memory that a process and its descendants are seen to take, by the looks so far: `most` [bytes].

    What several of them share is counted once; as the kernel takes long to say so of large processes, it is
    asked only when more pages than ever are in memory.
    """

    def __init__(self, pid: int) -> None:
        self.most = 0
        self._pid, self._pages = pid, 0

    def look(self) -> None:
        """Look once."""
        if (pages := _resident_pages(self._pid)) > self._pages:
            self._pages = pages
            self.most = max(self.most, tree_memory(self._pid))


@contextmanager
def watched_memory() -> Iterator[None]:
    """Look at the memory of this process's tree now and then, until the block ends."""
    ended = threading.Event()

    def watch() -> None:
        memory = MemoryWatch(os.getpid())
        while not ended.wait(_PERIOD):
            memory.look()
            _seen[0] = max(_seen[0], memory.most)

    watching = threading.Thread(target=watch, daemon=True)
    watching.start()
    try:
        yield
    finally:
        ended.set()
        watching.join()


def peak_memory() -> dict[str, int]:
    """
    Return the most memory of this process, and how much more it and its descendants took together [bytes].

    The latter by the looks of `watched_memory`, and as it is now; nothing where the system has no ``/proc``.
    """
    if not _PROC.is_dir():
        return {}
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _KIBI
    _seen[0] = max(_seen[0], own, tree_memory(os.getpid()))
    return {"process": own, "children": _seen[0] - own}
