"""What the first process of a run's pool does before it has work: the others are forked from it."""

from __future__ import annotations

# before the pool begins: what is imported here its processes have from the beginning, and as one
from lidar_buildings.commands import tile_work  # noqa: F401


def load_stages() -> None:
    """Load what works on tiles, compiled code by a call of each stage."""
    from lidar_buildings.commands import stage_calls

    for call in stage_calls.OF_RUNS:
        call()
