"""What a process and all that descend from it take, from the kernel's accounts."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

_PROC = Path("/proc")
_TICKS = os.sysconf("SC_CLK_TCK")


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
