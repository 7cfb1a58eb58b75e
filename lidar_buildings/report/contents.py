"""What a page shows of a result: which buildings, points and terrain fit into it."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.io.results.run_folder import DTM, Share
from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.report.models import ModelArrays, model_arrays
from lidar_buildings.report.relief import Relief, read_relief
from lidar_buildings.report.result_folder import ReportedBuilding, Result
from lidar_buildings.report.shown_points import ShownPoints, read_shown_points

#: What fits into 20 MB: a triangle takes some 10 bytes of the page, a point 9, a building's attributes 200.
MOST_BUILDINGS, MOST_TRIANGLES, MOST_POINTS = 4_000, 900_000, 400_000
#: Cells of the terrain along its longer side.
MOST_CELLS = 300
#: Width of the strip that is shown round the buildings where not all are [m].
_MARGIN = 30.0
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


@dataclass(frozen=True, eq=False)
class Contents:
    """What a page shows."""

    result: Result
    buildings: list[ReportedBuilding]  #: those that can be clicked, by row
    others: list[ReportedBuilding]  #: those that are dots on the map
    models: ModelArrays
    points: ShownPoints
    #: Of what is shown and, where that is not all, of all.
    terrain: Relief | None
    overview: Relief | None
    worst: list[Worst]  #: to be looked at first
    focus: int | None = None  #: row of the building that the page opens with


def contents_of(result: Result, focus: ReportedBuilding | None = None, share: Share = map) -> Contents:
    """
    Choose and read what a page shows; with a focus that building and what is next to it, with all its points.

    `share`, as `map`, may do its jobs, the models, in other processes.
    """
    every = result.buildings
    worst = [] if focus else worst_buildings(every, result.frame)
    near, box = _beside(every, focus) if focus else _in_the_middle(every)
    chosen = list({one.name: one for one in [*near, *(one.building for one in worst)]}.values())
    names = [one.name for one in chosen]
    path = result.folder / DTM if result.has(DTM) else None
    with ThreadPoolExecutor(1) as beside:  # decoding needs no interpreter
        reading = beside.submit(
            read_shown_points,
            result.clouds(),
            result.frame,
            {int(code): n for code, n in result.run.get("classes", {}).items()},
            {one.building_id: row for row, one in enumerate(chosen) if one.building_id},
            box,
            MOST_POINTS,
        )
        models = model_arrays(result.lines(set(names)), names, MOST_TRIANGLES, share)
        points = reading.result()
    return Contents(
        result=result,
        buildings=chosen,
        others=[] if focus or len(chosen) == len(every) else _without(every, set(names)),
        models=models,
        points=points,
        terrain=read_relief(path, result.frame, box, MOST_CELLS) if path else None,
        overview=read_relief(path, result.frame, None, MOST_CELLS) if path and box and not focus else None,
        worst=worst,
        focus=names.index(focus.name) if focus else None,
    )


def _in_the_middle(
    buildings: Sequence[ReportedBuilding],
) -> tuple[Sequence[ReportedBuilding], Rectangle | None]:
    """Return the buildings, or the budget of them nearest to their middle and where these are."""
    if len(buildings) <= MOST_BUILDINGS:
        return buildings, None
    places = shapely.get_coordinates(shapely.centroid(_shapes(buildings)))
    if len(places) < len(buildings):  # some have no outline, so that nothing tells what is near
        return buildings[:MOST_BUILDINGS], None
    far = np.abs(places - np.median(places, axis=0)).max(axis=1)
    near = [buildings[row] for row in np.sort(np.argsort(far, kind="stable")[:MOST_BUILDINGS])]
    return near, _box_of(near)


def _beside(
    buildings: Sequence[ReportedBuilding], focus: ReportedBuilding
) -> tuple[Sequence[ReportedBuilding], Rectangle | None]:
    """Return a building with those next to it, and where they are."""
    if focus.shape is None:
        return [focus], None
    box = _box_of([focus])
    is_near = shapely.intersects(_shapes(buildings), shapely.box(*box))
    return [one for one, near in zip(buildings, is_near, strict=True) if near or one is focus], box


def _without(buildings: Sequence[ReportedBuilding], names: set[str]) -> list[ReportedBuilding]:
    return [one for one in buildings if one.name not in names]


def _shapes(buildings: Sequence[ReportedBuilding]) -> NDArray[np.object_]:
    return np.array([one.shape for one in buildings], dtype=object)


def _box_of(buildings: Sequence[ReportedBuilding]) -> Rectangle:
    return Rectangle(*shapely.total_bounds(_shapes(buildings)).tolist()).grown(_MARGIN)


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
