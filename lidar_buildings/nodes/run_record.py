"""What the nodes' `diagnostics` hold of a run, for ``run.json``."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from lidar_buildings.core.model.replicas import ReplicaConfig
from lidar_buildings.io.results.run_summary import run_info
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.nodes.table import NODE_STAGES
from lidar_buildings.ros.stamps import tile_of


class RunRecord:
    """
    Seconds per stage, parameters and failed tiles of a run; `parameters` are those that no node reports.

    `failed` are the stamps of the tiles that were given up, in the revision that was sent last.
    """

    def __init__(self, parameters: Mapping[str, Any] = MappingProxyType({})) -> None:
        self.failed: set[int] = set()
        self._seconds: dict[str, dict[int, float]] = {stage: {} for stage in NODE_STAGES.values()}
        self._parameters: dict[str, Any] = dict(parameters)
        self._reasons: dict[int, str] = {}
        self._started = time.perf_counter()

    def add(self, message: DiagnosticArray) -> None:
        """
        Take one node's status of one tile, the last of which counts; its summaries say nothing here.

        ValueError if a number is none, or the parameters are not JSON of a node's.
        """
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            node = re.sub(r"_\d+$", "", status.name)  # of a replica, its kind
            if node not in NODE_CONFIGS or "tile" not in values:
                continue
            tile = tile_of(int(values["tile"]))
            if status.level == DiagnosticStatus.ERROR:
                self._reasons[tile] = f"{status.name}: {status.message}"
                continue
            told = json.loads(values.get("parameters", "{}"))
            if not isinstance(told, dict) or not told.keys() <= NODE_CONFIGS[node].keys():
                raise ValueError(f"parameters of {node} are {values['parameters'][:100]}")
            told.pop(ReplicaConfig.stage, None)
            self._parameters.update(told)
            if node in NODE_STAGES and "seconds" in values:
                self._seconds[NODE_STAGES[node]][tile] = float(values["seconds"])

    def has_all(self, stages: Iterable[str], stamps: set[int]) -> bool:
        """Whether the seconds of all these stages on all these tiles have come."""
        return all(self._seconds[stage].keys() >= stamps for stage in stages)

    def reasons(self, failed: Iterable[int]) -> dict[int, str]:
        """Return tile → the last error that a node reported of it."""
        return {stamp: self._reasons.get(stamp, "it did not finish in time") for stamp in sorted(failed)}

    def as_dict(self, failed: Mapping[int, str]) -> dict[str, Any]:
        """Return the content of ``run.json``; `failed` are what `reasons` returns."""
        seconds = {stage: sum(per.values()) for stage, per in self._seconds.items() if per}
        seconds = {"wall": time.perf_counter() - self._started, **seconds}
        return run_info(seconds, self._parameters, failed, ())
