"""What a process and all that descend from it take, from the kernel's accounts."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

Figure = TypeVar("Figure", int, float)

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
        with suppress(OSError, IndexError, StopIteration):
            found[one] = _memory(_PROC / str(one))
    return found


def children_cpu(pid: int) -> float:
    """Return the processor time that the living descendants of a process have had so far [s]."""
    return _sum(tree_of(pid)[1:], _cpu)


def tree_cpu(pid: int) -> float:
    """Return the processor time that a process and its living descendants have had so far [s]."""
    return _sum(tree_of(pid), _cpu)


def machine_cpu() -> float:
    """Return the processor time that all processes of the machine have had since it was started [s]."""
    user, nice, system, _, _, *interrupts = map(int, (_PROC / "stat").read_text().split("\n")[0].split()[1:8])
    return (user + nice + system + sum(interrupts)) / _TICKS


def _sum(pids: list[int], figure: Callable[[Path], Figure]) -> Figure:
    """Add a figure of processes up; those that have ended meanwhile count nothing."""
    total = type(figure(_PROC / "self"))()
    for pid in pids:
        with suppress(OSError, IndexError, StopIteration):
            total += figure(_PROC / str(pid))
    return total


def _memory(process: Path) -> int:
    """Proportional set size [bytes]."""
    lines = (process / "smaps_rollup").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("Pss:"))


def _cpu(process: Path) -> float:
    """User and system time of all threads, and of the children that were waited for [s]."""
    fields = (process / "stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / _TICKS
