"""
What the nodes say of a run on `diagnostics`, for ``run.json``.

"""

from __future__ import annotations

import json
from collections.abc import Iterable
from importlib import metadata
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from lidar_buildings import __version__
from lidar_buildings.nodes.table import NODE_STAGES

_LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn", "shapely", "laspy", "lazrs")


class RunRecord:
    """
    Seconds per stage, parameters and failed tiles of a run.

    Attributes
    ----------
    failed : set of int
        Stamps of the tiles that were given up.

    """

    def __init__(self) -> None:
        self.failed: set[int] = set()
        self._seconds: dict[str, dict[str, float]] = {stage: {} for stage in NODE_STAGES.values() if stage}
        self._parameters: dict[str, Any] = {}

    def add(self, message: DiagnosticArray) -> None:
        """
        Take what one node says of one tile; the last word on a tile counts.

        """
        for status in message.status:
            stage = NODE_STAGES.get(status.name)
            if not stage or status.level == DiagnosticStatus.ERROR:
                continue
            values = {pair.key: pair.value for pair in status.values}
            if "tile" in values and "seconds" in values:
                self._seconds[stage][values["tile"]] = float(values["seconds"])
            self._parameters.update(json.loads(values.get("parameters", "{}")))

    def as_dict(self, failed: Iterable[int], problems: Iterable[str]) -> dict[str, Any]:
        """
        Return what ``run.json`` is to tell.

        """
        return {
            "versions": {"lidar_buildings": __version__, **_versions()},
            "parameters": self._parameters,
            "seconds": {stage: round(sum(per.values()), 3) for stage, per in self._seconds.items() if per},
            "failed_tiles": sorted(failed),
            "problems": list(problems),
        }


def _versions() -> dict[str, str]:
    """
    Return the versions of the libraries that results depend on.

    """
    return {name: metadata.version(name) for name in _LIBRARIES}
