"""What a run takes of the machine: its own process and those that it started."""

from __future__ import annotations

import os
import resource
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from lidar_buildings.commands.process_tree import children_cpu, tree_memory
from lidar_buildings.commands.progress import RunOutcome, Usage

#: How often memory is looked at: a tile takes seconds, a look milliseconds [s].
_PERIOD = 0.5
#: Unit of the kernel's mark of the memory of a process [bytes].
_KIBI = 1024


def measured(run: Callable[[], RunOutcome]) -> RunOutcome:
    """
    Make a run whose processes are there already, and say in its outcome what these took.

    Where the system is not Linux nothing is said.
    """
    if not Path("/proc/self/smaps_rollup").exists():
        return run()
    ended, looks = threading.Event(), [0]

    def watch() -> None:
        while not ended.wait(_PERIOD):
            looks.append(max(looks.pop(), tree_memory(os.getpid())))

    watching = threading.Thread(target=watch, daemon=True)
    watching.start()
    try:
        outcome = run()
        processor = time.process_time() + children_cpu(os.getpid())
    finally:
        ended.set()
        watching.join()
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _KIBI
    return replace(outcome, usage=Usage(processor, max(own, *looks, tree_memory(os.getpid()))))
