"""Two results of one place, and what has changed between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.evaluation.changes.buildings import Change, judge_buildings
from lidar_buildings.evaluation.changes.cells import Limits, judge_cells, offset_of
from lidar_buildings.evaluation.changes.surfaces import CellPlan, see
from lidar_buildings.evaluation.readers.labelled_points import read_class_chunks
from lidar_buildings.evaluation.readers.metric_polygons import MetricPolygons, read_metric_polygons
from lidar_buildings.io.vectors.geopackage import VectorLayer, geopackage_file

#: Side of a cell [spacings of the sparser survey], rounded up to the step and at least the smallest [m].
_CELL_SPACINGS, _CELL_STEP, _SMALLEST_CELL = 1.5, 0.25, 0.5
#: A difference is none within so many standard deviations of what has not changed.
_SURE = 4.0
#: Roofs lie so many standard deviations of both outlines elsewhere at most, and their points within a cell so
#: many cells: what is left of the mean of four or more.
_OUTLINE_SIGMAS, _CELL_SHARE = 2.0, 0.25
#: Cells around outlines that are looked at, so that there is ground among them.
_MARGIN = 4
_FIELDS: dict[str, type] = {
    "change": str, "old_id": int, "new_id": int, "area": float, "height_change": float, "height_sigma": float,
    "share": float, "seen": float,
}  # fmt: skip
_ID = "building_id"


@dataclass(frozen=True)
class ChangeConfig:
    """From when on a difference is a change."""

    #: Of a roof's elevation [m]; raising it passes over chimneys, solar panels and rough roofs.
    min_height: float = 0.5
    min_area: float = 4.0  #: of a part of a roof [m²]; raising it passes over dormers
    min_storey: float = 1.5  #: height above ground from which a roof is a building [m]

    def __post_init__(self) -> None:
        for name in ("min_height", "min_area", "min_storey"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ParameterError(f"compare: {name} = {value!r}: must be positive and finite")


@dataclass(frozen=True, eq=False)
class Comparison:
    """What has changed."""

    #: The outlines of both results.
    old: MetricPolygons
    new: MetricPolygons
    changes: list[Change]  #: what has changed of which building
    words: tuple[list[str], list[str]]  #: what became of each building of either result
    #: By how much the new survey lies above the old one, and the scatter of what has not changed [m].
    offset: float
    scatter: float
    cell: float  #: side of the cells [m]

    def rows(self) -> list[dict[str, Any]]:
        """Return a row per change: what, of which buildings, how large, how sure."""
        ids = [_ids(self.old), _ids(self.new)]
        return [
            {
                "change": one.change,
                "old_id": None if one.old < 0 else int(ids[0][one.old]),
                "new_id": None if one.new < 0 else int(ids[1][one.new]),
                "area": round(one.area, 2),
                "height_change": round(one.height, 3),
                "height_sigma": round(one.sigma, 4),
                "share": round(one.share, 4),
                "seen": round(one.seen, 4),
            }
            for one in self.changes
        ]

    def write(self, path: Path) -> None:
        """
        Write a GeoPackage: `changes` by place; `old` and `new`, the buildings of both results, with theirs.

        OutputError if it cannot be written.
        """
        places = shapely.transform([one.place for one in self.changes], lambda xy: xy / self.new.unit)
        with geopackage_file(path, self.new.crs) as add:
            parts, owner = shapely.get_parts(places, return_index=True)
            rows = self.rows()
            add(VectorLayer("changes", parts, _FIELDS, [rows[k] for k in owner]))
            for name, side, words in zip(("old", "new"), (self.old, self.new), self.words, strict=True):
                polygons = shapely.transform(side.polygons, lambda xy, unit=side.unit: xy / unit)
                own = [{_ID: int(one), "change": word} for one, word in zip(_ids(side), words, strict=True)]
                add(VectorLayer(name, list(polygons), {_ID: int, "change": str}, own))


def compare_runs(old: Path, new: Path, config: ChangeConfig | None = None) -> Comparison:
    """
    Tell what has changed between two results of one place.

    Points decide what has changed, outlines of what: classes and heights of both surveys are compared in
    cells, less the offset between them, and what differs by more than points and outlines are sure of is a
    change (see `cells`). Memory grows with the buildings' area. InputError if one is no output folder with
    `buildings.gpkg` and `classified/`, or both lie in different reference systems or apart.
    """
    config = config or ChangeConfig()
    sides = (read_metric_polygons(old), read_metric_polygons(new))
    for side, path in zip(sides, (old, new), strict=True):
        if _ID not in side.attributes:
            raise InputError(f"{path}: is no output folder of a run: its buildings have no {_ID}")
    if sides[0].crs != sides[1].crs:
        raise InputError(
            f"{old} is in {sides[0].crs or 'no reference system'}, {new} in {sides[1].crs or 'none'}: "
            "give results in one"
        )
    polygons = np.concatenate([side.polygons for side in sides])
    if not len(polygons):
        return Comparison(*sides, [], ([], []), 0.0, 0.0, _SMALLEST_CELL)
    cell = _cell_size(sides)
    shift = _OUTLINE_SIGMAS * math.hypot(*(_median(side, "outline_sigma") for side in sides))
    plan = CellPlan.around(polygons, cell, _MARGIN)
    before, after = (see(plan, read_class_chunks(path)) for path in (old, new))
    offset, scatter = offset_of(before, after)
    limits = Limits(
        max(config.min_height, _SURE * scatter),
        config.min_area,
        config.min_storey,
        shift + _CELL_SHARE * cell,
    )
    cells = judge_cells(plan, before, after, offset, limits)
    changes, words = judge_buildings(cells, (sides[0].polygons, sides[1].polygons), scatter)
    return Comparison(*sides, changes, words, offset, scatter, cell)


def _cell_size(sides: tuple[MetricPolygons, MetricPolygons]) -> float:
    spacing = max(_median(side, "point_spacing") for side in sides)
    return max(_SMALLEST_CELL, math.ceil(_CELL_SPACINGS * spacing / _CELL_STEP) * _CELL_STEP)


def _median(side: MetricPolygons, name: str) -> float:
    """Return the median of a column of lengths [m], 0 without any."""
    values = np.asarray(side.attributes.get(name, ()), dtype=np.float64) * side.unit
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else 0.0


def _ids(side: MetricPolygons) -> NDArray[Any]:
    return np.asarray(side.attributes[_ID])
