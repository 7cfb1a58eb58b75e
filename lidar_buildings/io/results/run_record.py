"""What stages report of a run while tiles come, for ``run.json``."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.io.results.run_summary import run_info


class RunRecord:
    """
    What is told of a run: `parameters`, `seconds` by stage and tile, and the last of the `errors` by tile.

    `failed` are the stamps of the tiles that were given up, in the revision that was sent last.
    """

    def __init__(self, parameters: Mapping[str, Any] = MappingProxyType({})) -> None:
        self.parameters: dict[str, Any] = dict(parameters)
        self.seconds: dict[str, dict[int, float]] = {stage: {} for stage in STAGES}
        self.errors: dict[int, str] = {}
        self.failed: set[int] = set()
        self._started = time.perf_counter()

    def has_all(self, stages: Iterable[str], tiles: set[int]) -> bool:
        """Whether the seconds of all these stages on all these tiles have come."""
        return all(self.seconds[stage].keys() >= tiles for stage in stages)

    def reasons(self, failed: Iterable[int]) -> dict[int, str]:
        """Return tile → the last error that was reported of it."""
        return {tile: self.errors.get(tile, "it did not finish in time") for tile in sorted(failed)}

    def as_dict(self, failed: Mapping[int, str]) -> dict[str, Any]:
        """Return the content of ``run.json``; `failed` are what `reasons` returns."""
        seconds = {stage: sum(per.values()) for stage, per in self.seconds.items() if per}
        seconds = {"wall": time.perf_counter() - self._started, **seconds}
        return run_info(seconds, self.parameters, failed, ())
