"""What a run takes of the machine: its own process and those that it started."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import replace

from lidar_buildings.commands.progress import RunOutcome, Usage
from lidar_buildings.io.results.process_tree import cpu_of, peak_memory, tree_of, watched_memory


def measured(run: Callable[[], RunOutcome]) -> RunOutcome:
    """Make a run whose processes are there already, and say in its outcome what these took."""
    with watched_memory():
        outcome = run()
        processor = time.process_time() + cpu_of(tree_of(os.getpid())[1:])
    memory = sum(peak_memory().values())
    return replace(outcome, usage=Usage(processor, memory) if memory else None)
