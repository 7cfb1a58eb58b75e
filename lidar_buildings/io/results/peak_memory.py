"""How much memory a run has taken at most."""

from __future__ import annotations

import os
import re
from pathlib import Path

_PEAK = re.compile(r"VmHWM:\s+(\d+) kB")


def peak_memory() -> dict[str, int]:
    """
    Return the most memory that this process has held, and the sum of what its living children have [bytes].

    Pages that a child shares with it are counted in both; nothing is told where the system has no ``/proc``.
    """
    own = Path("/proc", str(os.getpid()))
    if not own.is_dir():
        return {}
    children = [pid for task in (own / "task").glob("*/children") for pid in _read(task).split()]
    return {
        "process": _peak(own),
        "children": sum(_peak(Path("/proc", pid)) for pid in children),
    }


def _peak(process: Path) -> int:
    found = _PEAK.search(_read(process / "status"))
    return 1024 * int(found[1]) if found else 0


def _read(path: Path) -> str:
    """Return a file's text, nothing if its process has ended."""
    try:
        return path.read_text()
    except OSError:
        return ""
