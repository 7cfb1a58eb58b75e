"""What has changed of which building between two results; the command ``lidar-buildings compare``."""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.evaluation.changes.cells import (
    BUILT,
    HIGHER,
    LOWER,
    REMOVED,
    UNSEEN,
    CellChanges,
    CellPlan,
    Limits,
    judge_cells,
    offset_of,
    see,
)
from lidar_buildings.evaluation.readers.labelled_points import read_class_chunks
from lidar_buildings.evaluation.readers.metric_polygons import MetricPolygons, read_metric_polygons
from lidar_buildings.io.vectors.layers import VectorLayer, geopackage_file

#: Share of a building's cells that decides of the whole of it.
WHOLE = 0.7
#: Share of a building that may lie on one of the other survey if it is to be new, or gone.
MOST_SHARED = 0.2
#: Least share of a building's cells that both surveys have to tell of.
LEAST_SEEN = 0.3
#: What a change of all, and of a part of a building is called.
_OF_ALL = {BUILT: "new", REMOVED: "gone", HIGHER: "raised", LOWER: "lowered"}
_OF_PART = {BUILT: "extended", REMOVED: "reduced", HIGHER: "roof changed", LOWER: "roof changed"}
UNCHANGED, NOT_SEEN = "unchanged", "not seen"


class Change(NamedTuple):
    """What has changed of a building."""

    #: ``"new"``, ``"gone"``, ``"raised"``, ``"lowered"``, ``"extended"``, ``"reduced"``, ``"roof changed"``.
    change: str
    #: Row of the building in either survey, −1 where it is in none.
    old: int
    new: int
    area: float  #: of what has changed [m²]
    #: Median change of elevation; for what was built or removed, the height of the roof above ground [m].
    height: float
    sigma: float  #: standard deviation of `height` by the scatter of what has not changed [m]
    #: Of the building's cells that have changed, and that both surveys tell of.
    share: float
    seen: float
    place: Any  #: where: the outline, or the cells of a part [m]


def judge_buildings(
    cells: CellChanges, outlines: tuple[NDArray[Any], NDArray[Any]], scatter: float
) -> tuple[list[Change], tuple[list[str], list[str]]]:
    """
    Tell what has changed of which building.

    `scatter` is that of the elevations of single cells that have not changed [m]. Changes come in the order
    of the new buildings, then those of the old survey alone; beside them for every building of either what
    has changed most, ``"unchanged"`` or ``"not seen"``.
    """
    partner = [_partners(outlines[1], outlines[0]), _partners(outlines[0], outlines[1])]
    changes: list[Change] = []
    words: tuple[list[str], list[str]] = ([], [])
    for row, outline in enumerate(outlines[1]):
        shared, other = partner[0][row]
        found = _of_building(cells, outline, other if shared else -1, row, scatter, shared, REMOVED)
        changes += found[0]
        words[1].append(found[1])
    for row, outline in enumerate(outlines[0]):
        shared, other = partner[1][row]
        found = _of_building(cells, outline, row, -1, scatter, shared, BUILT)
        words[0].append(found[1] if found[1] != UNCHANGED or not shared else words[1][other])
        changes += [one for one in found[0] if one.change in ("gone", "reduced")]
    return changes, words


def _partners(mine: NDArray[Any], theirs: NDArray[Any]) -> list[tuple[float, int]]:
    """Return for each outline the share of it that others cover, and which covers most, −1 for none."""
    left, right = shapely.STRtree(theirs).query(mine, predicate="intersects")
    common = shapely.area(shapely.intersection(mine[left], theirs[right]))
    share = np.bincount(left, common, len(mine)) / np.maximum(shapely.area(mine), 1e-9)
    most = np.full(len(mine), -1)
    for pair in np.lexsort((right, common)):  # the largest last
        most[left[pair]] = right[pair]
    return [(min(float(one), 1.0), int(other)) for one, other in zip(share, most, strict=True)]


def _of_building(
    cells: CellChanges, outline: Any, old: int, new: int, scatter: float, shared: float, foreign: int
) -> tuple[list[Change], str]:
    """Return what has changed within an outline, and the word for it."""
    size = cells.plan.size
    middles, state, heights = cells.within(outline)
    n_seen, n = int(np.count_nonzero(state != UNSEEN)), max(len(state), 1)
    if n_seen < LEAST_SEEN * n:
        return [], NOT_SEEN
    changes = []
    for kind in (BUILT, REMOVED, HIGHER, LOWER):
        is_kind = state == kind
        count = int(is_kind.sum())
        if not count or kind == foreign:
            continue
        is_all = count >= WHOLE * n_seen and (kind in (HIGHER, LOWER) or shared <= MOST_SHARED)
        if not is_all and count * size**2 < cells.least:
            continue
        place = outline if is_all else _joined(middles[is_kind] - 0.5 * size, size)
        height = float(np.median(heights[is_kind]))
        word = (_OF_ALL if is_all else _OF_PART)[kind]
        area = outline.area if is_all else count * size**2
        sigma = scatter / np.sqrt(count)
        changes.append(Change(word, old, new, area, height, sigma, count / n_seen, n_seen / n, place))
    most = max(changes, key=lambda one: one.share, default=None)
    return changes, UNCHANGED if most is None else most.change


def _joined(corners: NDArray[np.float64], size: float) -> Any:
    x, y = corners.T
    return shapely.union_all(shapely.box(x, y, x + size, y + size))


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
            raise InputError(f"{path}: is not an output folder of a run: its buildings have no {_ID}")
    if sides[0].crs != sides[1].crs:
        raise InputError(
            f"{old} is in {sides[0].crs or 'no reference system'}, {new} in {sides[1].crs or 'none'}: "
            "give results in the same one"
        )
    polygons = np.concatenate([side.polygons for side in sides])
    if not len(polygons):
        return Comparison(*sides, [], ([], []), 0.0, 0.0, _SMALLEST_CELL)
    spacing = max(_median(side, "point_spacing") for side in sides)
    cell = max(_SMALLEST_CELL, math.ceil(_CELL_SPACINGS * spacing / _CELL_STEP) * _CELL_STEP)
    shift = _OUTLINE_SIGMAS * math.hypot(*(_median(side, "outline_sigma") for side in sides))
    plan = CellPlan.around(polygons, cell, _MARGIN)
    before, after = (see(plan, read_class_chunks(path)) for path in (old, new))
    offset, scatter = offset_of(before, after)
    least = max(config.min_height, _SURE * scatter)
    limits = Limits(least, config.min_area, config.min_storey, shift + _CELL_SHARE * cell)
    cells = judge_cells(plan, before, after, offset, limits)
    changes, words = judge_buildings(cells, (sides[0].polygons, sides[1].polygons), scatter)
    return Comparison(*sides, changes, words, offset, scatter, cell)


def _median(side: MetricPolygons, name: str) -> float:
    values = np.asarray(side.attributes.get(name, ()), dtype=np.float64) * side.unit
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else 0.0


def _ids(side: MetricPolygons) -> NDArray[Any]:
    return np.asarray(side.attributes[_ID])


#: File of the changes, in the new result's folder unless another is named.
CHANGES = "changes.gpkg"


def compare_command(options: argparse.Namespace) -> int:
    """
    Execute ``lidar-buildings compare``: write the changes, print them, return 0.

    InputError if one of both is no output folder of a run, or they do not fit together; OutputError if the
    file cannot be written; ParameterError if a limit is out of range.
    """
    config = ChangeConfig(min_height=options.min_height, min_area=options.min_area)
    found = compare_runs(options.old, options.new, config)
    path = options.output or options.new / CHANGES
    found.write(path)
    rows = found.rows()
    totals = Counter(found.words[1]) + Counter(word for word in found.words[0] if word == "gone")
    if options.json:
        told = {name: getattr(found, name) for name in ("offset", "scatter", "cell")}
        told["buildings"] = dict(totals)
        print(json.dumps({**told, "changes": rows}, indent=2))
        return 0
    print(
        f"{len(found.old.polygons)} buildings before, {len(found.new.polygons)} now; NEW lies "
        f"{found.offset:+.3f} m higher,"
    )
    print(f"unchanged single cells of {found.cell:g} m scatter by {found.scatter:.3f} m")
    print("buildings: " + (", ".join(f"{n} {word}" for word, n in sorted(totals.items())) or "none"))
    for row in rows:
        names = [f"{side} {row[f'{side}_id']}" for side in ("old", "new") if row[f"{side}_id"] is not None]
        size = f"{row['area']:.0f} m², {row['height_change']:+.2f} ± {row['height_sigma']:.3f} m"
        print(f"  {row['change']:13s} {size:28s} {100 * row['share']:3.0f} % of it   {', '.join(names)}")
    print(f"  {path}")
    return 0
