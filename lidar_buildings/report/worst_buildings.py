"""Which buildings of a result are to be looked at first, and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.report.result_folder import ReportedBuilding

_MOST = 10
#: Statuses from bad to good; what is not among them is as good as `ok`.
_RANKS = {
    BuildingStatus.FAILED: 5,
    BuildingStatus.NO_SOLID: 4,
    BuildingStatus.DEGENERATE: 3,
    BuildingStatus.CUT_OFF: 2,
    BuildingStatus.TRACED_OUTLINE: 1,
}
#: A model whose points lie so far off on the root mean square is as bad as one that covers nothing [m].
_BAD_RMSE = 1.0


class Worst(NamedTuple):
    """One of the worst, and why."""

    building: ReportedBuilding
    why: str


def worst_buildings(buildings: Sequence[ReportedBuilding], frame: MapFrame) -> list[Worst]:
    """
    Return the ten worst, the worst first.

    A status that is not `ok` comes first, then a missing level of detail, then what the points say: the share
    of the outline without support by points, and their distances to the model.
    """
    ordered = sorted(buildings, key=_badness, reverse=True)[:_MOST]
    return [Worst(one, why_bad(one, frame)) for one in ordered]


def why_bad(building: ReportedBuilding, frame: MapFrame) -> str:
    """Say in a few words what speaks against a building."""
    known = building.attributes
    words = [f"{building.status}: {known['reason']}" if known.get("reason") else building.status]
    if known.get("lod") not in (None, "2.2"):
        words.append(f"finest level {known['lod'] or 'none'}")
    if known.get("coverage") is not None:
        words.append(f"coverage {known['coverage']:.2f}")
    if known.get("rmse") is not None:
        words.append(f"rmse {known['rmse'] * frame.vertical_unit:.2f} m")
    if known.get("outline_max_offset"):
        words.append(f"outline off by {known['outline_max_offset'] * frame.horizontal_unit:.2f} m at most")
    return "; ".join(words)


def _badness(building: ReportedBuilding) -> tuple[float, ...]:
    known: dict[str, Any] = building.attributes
    coverage, rmse = known.get("coverage"), known.get("rmse")
    unsupported = 0.0 if coverage is None else 1.0 - coverage
    return (
        next((rank for status, rank in _RANKS.items() if status.value == building.status), 0),
        float(known.get("lod") not in (None, "2.2")),
        unsupported + (rmse or 0.0) / _BAD_RMSE,
    )
