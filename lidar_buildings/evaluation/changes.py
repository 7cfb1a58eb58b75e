"""
What has changed between two surveys of one place: per building, by how much and how sure.

Also the command ``lidar-buildings compare``.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.errors import InputError, ParameterError
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.core.surfaces.roof_planes import POINTS_SHARED
from lidar_buildings.evaluation.readers.labelled_points import read_class_chunks
from lidar_buildings.evaluation.readers.metric_polygons import MetricPolygons, read_metric_polygons
from lidar_buildings.evaluation.readers.true_lengths import scale_of, scaled
from lidar_buildings.evaluation.scores.cells import CellSet, cell_centres, cells_of_polygons, keys_of
from lidar_buildings.io.results.run_summary import counted
from lidar_buildings.io.vectors.layers import VectorLayer, geopackage_file

#: Classes that say that nothing stood there.
_GROUND = (PointClass.GROUND, PointClass.WATER, PointClass.ROAD_SURFACE)
#: Classes that say nothing.
_NOISE = (PointClass.LOW_NOISE, PointClass.HIGH_NOISE)


@dataclass(frozen=True)
class CellPlan:
    """The cells that are looked at, the same for both surveys."""

    size: float  #: side of a cell [m]
    cells: CellSet  #: those in or near an outline

    @classmethod
    def around(cls, polygons: NDArray[Any], size: float, margin: int) -> CellPlan:
        """Return the cells within some cells of polygons, of which there is at least one."""
        return cls(size, cells_of_polygons(shapely.buffer(polygons, margin * size), size))

    @cached_property
    def neighbours(self) -> NDArray[np.int64]:
        """Rows of the three by three cells about each cell, n_cells for none, shape (9, n_cells)."""
        found = np.full((9, len(self.cells)), len(self.cells))
        for place, (east, north) in enumerate(product((-1, 0, 1), repeat=2)):
            keys = self.cells + (east << 32) + north
            row = np.minimum(np.searchsorted(self.cells, keys), len(keys) - 1)
            found[place] = np.where(self.cells[row] == keys, row, len(keys))
        return found

    def about(self, values: NDArray[Any], none: Any) -> NDArray[Any]:
        """Return the values of each cell and those next to it, `none` where there is no cell."""
        return np.append(values, none)[self.neighbours]

    def parts(self, chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Number the connected parts of some cells; each of the others is a part of its own."""
        place, cell = np.nonzero(self.about(chosen, False) & chosen)
        return sets_of_pairs(len(chosen), cell, self.neighbours[place, cell])


class Surfaces(NamedTuple):
    """What one survey saw in each cell of a plan, elevations [m] of shape (n_cells,)."""

    roof: NDArray[np.float64]  #: mean of points of roofs, NaN where there is none
    roof_low: NDArray[np.float64]  #: the least and greatest of these, infinite the wrong way round for none
    roof_high: NDArray[np.float64]
    other_low: NDArray[np.float64]  #: those of what is neither roof nor ground
    other_high: NDArray[np.float64]
    ground: NDArray[np.float64]  #: mean of ground, NaN where there is none
    #: How far east and north of the middle of the cell the mean of points of roofs is, (n_cells, 2) [m].
    place: NDArray[np.float64]

    def moved(self, rise: float) -> Surfaces:
        """Return what was seen, moved upwards [m]."""
        return Surfaces(*(one + rise for one in self[:-1]), self.place)

    def around(self, plan: CellPlan, kind: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the least and greatest elevation of a kind in a cell and those next to it."""
        low, high = getattr(self, f"{kind}_low"), getattr(self, f"{kind}_high")
        return plan.about(low, np.inf).min(axis=0), plan.about(high, -np.inf).max(axis=0)

    def gradient(self, plan: CellPlan) -> NDArray[np.float64]:
        """Return how roofs rise to the east and north that go on straight, (n_cells, 2); NaN elsewhere."""
        about, rises = plan.about(self.roof, np.nan), np.empty((len(self.roof), 2))
        for axis, (before, after) in enumerate(((1, 7), (3, 5))):
            here = self.place[:, axis]
            place = plan.about(here, 0.0)
            rise = (about[after] - about[before]) / (2.0 * plan.size + place[after] - place[before])
            bend = about[before] + about[after] - 2.0 * self.roof
            bend -= rise * (place[before] + place[after] - 2.0 * here)
            rises[:, axis] = np.where(np.abs(bend) <= _MAX_BEND, rise, np.nan)
        spread = self.roof_high - self.roof_low - np.abs(rises).sum(axis=1) * plan.size
        rises[spread > _MAX_SPREAD] = np.nan  # a step in the middle of the cell
        return rises


def see(plan: CellPlan, chunks: Iterable[tuple[NDArray[Any], ...]]) -> Surfaces:
    """Return what a survey saw, of chunks of points [m], classes, and façade marks of those of buildings."""
    n, places = len(plan.cells), np.zeros((len(plan.cells), 2))
    counts, sums = np.zeros((2, 2, n))
    middles = cell_centres(plan.cells, plan.size)
    ends = [(np.full(n, np.inf), np.full(n, -np.inf)) for _ in range(2)]
    for points, classes, facade in chunks:
        keys = keys_of(points[:, :2], plan.size)
        cell = np.searchsorted(plan.cells, keys)
        cell[cell == n] = 0
        is_facade = facade.astype(bool)
        is_seen = (plan.cells[cell] == keys) & ~np.isin(classes, _NOISE)
        is_roof = is_seen & (classes == PointClass.BUILDING) & ~is_facade
        is_ground = is_seen & np.isin(classes, _GROUND)
        for kind, rows in enumerate((is_roof, is_ground)):
            counts[kind] += np.bincount(cell[rows], minlength=n)
            sums[kind] += np.bincount(cell[rows], points[rows, 2], n)
        for axis in range(2):
            away = points[is_roof, axis] - middles[cell[is_roof], axis]
            places[:, axis] += np.bincount(cell[is_roof], away, n)
        is_other = is_seen & ~is_roof & ~is_ground & ~is_facade
        for (low, high), rows in zip(ends, (is_roof, is_other), strict=True):
            np.minimum.at(low, cell[rows], points[rows, 2])
            np.maximum.at(high, cell[rows], points[rows, 2])
    roof, ground = np.where(counts > 0, sums / np.maximum(counts, 1.0), np.nan)
    return Surfaces(roof, *ends[0], *ends[1], ground, places / np.maximum(counts[:1].T, 1.0))


#: What becomes of a cell.
SAME, UNSEEN, BUILT, REMOVED, HIGHER, LOWER = range(6)
#: A roof goes on straight from cell to cell up to this: twice the noise of means and some roughness [m].
_MAX_BEND = 0.2
#: Rounds of finding what both surveys lie apart in plan, and the weight of none beside what slopes tell of it
#: (sum of their squares over cells).
_ROUNDS, _LEAST_SLOPES = 5, 3.0
#: What lies within this in a cell is one roof, though it ends there [m].
_MAX_SPREAD = 0.3


class Limits(NamedTuple):
    """From when on a difference is a change."""

    height: float  #: of a roof's elevation [m]
    area: float  #: of a part of a roof [m²]
    storey: float  #: of a roof above ground that was free before [m]


@dataclass(frozen=True, eq=False)
class CellChanges:
    """What became of each cell of a plan."""

    plan: CellPlan
    #: `SAME`, `UNSEEN`, `BUILT`, `REMOVED`, `HIGHER` or `LOWER`, in the order of the plan's cells, shape
    #: (n_cells,).
    state: NDArray[np.int8]
    #: By how much the roof is higher, or rises above what was free [m], shape (n_cells,).
    height: NDArray[np.float64]
    least: float  #: area of the least part that is a change [m²]

    def within(self, polygon: Any) -> tuple[NDArray[np.float64], NDArray[np.int8], NDArray[np.float64]]:
        """Return the cells whose middles lie in a polygon: these [m], states, heights."""
        cells = cells_of_polygons(polygon, self.plan.size)
        at = np.searchsorted(self.plan.cells, cells)
        return cell_centres(cells, self.plan.size), self.state[at], self.height[at]


class Rises(NamedTuple):
    """By how much the roofs of a survey are higher than those of another, cell by cell."""

    rise: NDArray[np.float64]  #: [m], NaN where one has seen none, shape (n_cells,)
    #: Whether each survey's roof goes on straight there, so that it is known where the other's points lie on
    #: it, shape (2, n_cells).
    is_straight: NDArray[np.bool_]
    offset: float  #: by how much the whole survey lies above the other [m], taken off
    shift: NDArray[np.float64]  #: by how much it lies to the east and north [m], taken off as slopes tell it
    scatter: float  #: of what has not changed [m]


def rises_of(plan: CellPlan, old: Surfaces, new: Surfaces) -> Rises:
    """
    Return by how much roofs are higher, less what both surveys lie apart.

    A cell's points have their mean elsewhere in each survey: on straight roofs what the slope makes of that
    is taken off. The offset is the median over ground that both have seen, or over roofs if there is none: a
    few houses that were raised are no offset. The shift in plan is what slopes make of it, by least squares
    without what differs by more than most does. The scatter is that of single cells of roofs or ground about
    their medians, whichever is larger, as most of a place has not changed.
    """
    gradients = np.stack([old.gradient(plan), new.gradient(plan)])
    is_straight = np.isfinite(gradients).all(axis=2)
    n_straight = is_straight.sum(axis=0)
    slope = np.where(is_straight[:, :, None], gradients, 0.0).sum(axis=0) / np.maximum(n_straight, 1)[:, None]
    rise = new.roof - old.roof - (slope * (new.place - old.place)).sum(axis=1)
    ground = _middle(new.ground - old.ground)
    roof = _middle(rise)
    offset = (ground or roof or (0.0, 0.0))[0]
    rise = rise - offset
    known = np.flatnonzero(np.isfinite(rise) & (n_straight > 0))
    shift = _shift_of(slope[known], rise[known])
    rise += slope @ shift
    scatter = max(one[1] for one in (ground, _middle(rise), (0.0, 0.0)) if one)
    return Rises(rise, is_straight, offset, shift, scatter)


def _middle(away: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the median and the scatter of what is known of differences, None if nothing is."""
    known = away[np.isfinite(away)]
    if not len(known):
        return None
    middle = float(np.median(known))
    return middle, 1.4826 * float(np.median(np.abs(known - middle)))


def _shift_of(slope: NDArray[np.float64], rise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how much roofs of these slopes, (n, 2), were shifted in plan, as these rises tell [m]."""
    shift = np.zeros(2)
    for _ in range(_ROUNDS):
        off = rise + slope @ shift
        middle = _middle(off)
        if middle is None:
            break
        used = np.abs(off) <= 3.0 * max(middle[1], _MAX_BEND / 3.0)
        normal = slope[used].T @ slope[used] + _LEAST_SLOPES * np.eye(2)
        shift = -np.linalg.solve(normal, slope[used].T @ rise[used])
    return shift


def judge_cells(plan: CellPlan, old: Surfaces, new: Surfaces, rises: Rises, limits: Limits) -> CellChanges:
    """
    Tell what became of each cell; `rises` are those of the new survey above the old one.

    On a smooth roof a cell has changed by its rise. Elsewhere all that is seen of its roof has to lie beyond
    all that the other survey has seen of roofs in the cells around: an edge that lies somewhat elsewhere is
    no change (as Murakami and others 1999, who shrink and expand differences), nor are wires above; but cells
    that have changed in the mean go with those beside them that have for sure. A roof is built where the
    other survey has seen ground and no roof around, nor anything else at its height: what is only classified
    otherwise is no change, and what one survey has not seen, behind a wall, is not told.
    """
    before, after = old, new.moved(-rises.offset)
    state, height = np.full(len(plan.cells), UNSEEN, dtype=np.int8), np.zeros(len(plan.cells))
    both = ((after, before, BUILT, 1.0), (before, after, REMOVED, -1.0))
    for number, (one, other, kind, sign) in enumerate(both):
        has_roof = np.isfinite(one.roof)
        rise = sign * rises.rise
        state[np.isfinite(rise) & (state == UNSEEN)] = SAME
        is_sloped, is_straight = rises.is_straight[number], rises.is_straight[1 - number]
        is_plain = is_straight | (one.roof_high - one.roof_low <= _MAX_SPREAD)
        low, high = other.around(plan, "roof")
        gap = _gap(one.roof_low, one.roof_high, low, high)
        away = np.where(is_sloped | is_straight, np.abs(rise), 0.0)
        is_sure = np.where(is_sloped & is_plain, away, np.abs(gap)) > limits.height
        part = plan.parts(is_sure | (away > limits.height))
        is_more = np.isin(part, part[is_sure]) & np.isfinite(rise)
        height[is_more] = sign * rise[is_more]
        state[is_more] = np.where(height[is_more] > 0.0, HIGHER, LOWER)
        storey = one.roof - other.ground
        is_free = has_roof & (low > high) & np.isfinite(storey)
        is_other = _gap(one.roof, one.roof, *other.around(plan, "other")) == 0.0
        is_built = is_free & (storey >= limits.storey) & ~is_other
        state[is_built], height[is_built] = kind, sign * storey[is_built]
        state[has_roof & (is_free | is_other) & (state == UNSEEN)] = SAME
    for kind in (BUILT, REMOVED, HIGHER, LOWER):
        _drop_small(plan, state, kind, limits.area / plan.size**2)
    return CellChanges(plan, state, height, limits.area)


def _gap(low: Any, high: Any, other_low: Any, other_high: Any) -> NDArray[np.float64]:
    """Return how far ranges of elevations lie above or below others, 0 if they meet; NaN without one."""
    with np.errstate(invalid="ignore"):
        away = np.where(low > other_high, low - other_high, np.minimum(high - other_low, 0.0))
        return np.where((low <= high) & (other_low <= other_high), away, np.nan)


def _drop_small(plan: CellPlan, state: NDArray[np.int8], kind: int, least: float) -> None:
    """Leave of a kind only parts of some cells, of blocks of two by two."""
    is_kind = state == kind
    # Places 4, 5, 7 and 8 are those of a block from its south-western cell on, 0, 1, 3 and 4 the way back.
    is_block = plan.about(is_kind, False)[[4, 5, 7, 8]].all(axis=0)
    kept = plan.about(is_block, False)[[0, 1, 3, 4]].any(axis=0)
    part = plan.parts(kept)
    is_large = np.bincount(part, minlength=len(part))[part] >= least
    state[is_kind & ~(kept & is_large)] = SAME


#: Share of a building's cells that decides of the whole of it.
WHOLE = 0.7
#: Share of a building that may lie on one of the other survey if it is to be new, or gone.
MOST_SHARED = 0.2
#: Least share of a building's cells that both surveys have to tell of.
LEAST_SEEN = 0.3
#: A roof has not changed in height within so many standard deviations.
_SIGNIFICANT = 3.0
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
    #: Standard deviation of `height` [m]: by the scatter of what has not changed and, for roofs that both
    #: results have, by how sure the planes of both models are.
    sigma: float
    #: Of the building's cells that have changed, and that both surveys tell of.
    share: float
    seen: float
    place: Any  #: where: the outline, or the cells of a part [m]


def judge_buildings(
    cells: CellChanges,
    outlines: tuple[NDArray[Any], NDArray[Any]],
    scatter: float,
    sigmas: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> tuple[list[Change], tuple[list[str], list[str]]]:
    """
    Tell what has changed of which building.

    `scatter` is that of the elevations of single cells that have not changed, `sigmas` how sure the heights
    of each building of both results are, 0 if that is not known [m]. Changes come in the order
    of the new buildings, then those of the old survey alone; beside them for every building of either what
    has changed most, ``"unchanged"`` or ``"not seen"``.
    """
    partner = [_partners(outlines[1], outlines[0]), _partners(outlines[0], outlines[1])]
    changes: list[Change] = []
    words: tuple[list[str], list[str]] = ([], [])
    for row, outline in enumerate(outlines[1]):
        shared, other = partner[0][row]
        unsure = math.hypot(sigmas[1][row], sigmas[0][other] if shared else 0.0)
        found = _of_building(cells, outline, other if shared else -1, row, (scatter, unsure), shared, REMOVED)
        changes += found[0]
        words[1].append(found[1])
    for row, outline in enumerate(outlines[0]):
        shared, other = partner[1][row]
        unsure = math.hypot(sigmas[0][row], sigmas[1][other] if shared else 0.0)
        found = _of_building(cells, outline, row, -1, (scatter, unsure), shared, BUILT)
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
    cells: CellChanges,
    outline: Any,
    old: int,
    new: int,
    sigmas: tuple[float, float],
    shared: float,
    foreign: int,
) -> tuple[list[Change], str]:
    """Return what has changed within an outline, and the word for it; sigmas of a cell and of both models."""
    size, (scatter, unsure) = cells.plan.size, sigmas
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
        sigma = scatter / math.sqrt(count)
        if kind in (HIGHER, LOWER):
            sigma = math.hypot(sigma, unsure)
            if abs(height) < _SIGNIFICANT * sigma:
                continue
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
        ids = [side.attributes[_ID] for side in (self.old, self.new)]
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
        """Write a GeoPackage: `changes` by place; buildings with theirs, `old` and `new`; or OutputError."""
        places = shapely.transform(
            [one.place for one in self.changes], lambda xy: xy / (self.new.unit * self.new.scale)
        )
        with geopackage_file(path, self.new.crs) as add:
            parts, owner = shapely.get_parts(places, return_index=True)
            rows = self.rows()
            add(VectorLayer("changes", parts, _FIELDS, [rows[k] for k in owner]))
            for name, side, words in zip(("old", "new"), (self.old, self.new), self.words, strict=True):
                polygons = shapely.transform(side.polygons, lambda xy, unit=side.unit * side.scale: xy / unit)
                own = [
                    {_ID: int(one), "change": word}
                    for one, word in zip(side.attributes[_ID], words, strict=True)
                ]
                add(VectorLayer(name, list(polygons), {_ID: int, "change": str}, own))


def compare_runs(old: Path, new: Path, config: ChangeConfig | None = None) -> Comparison:
    """
    Tell what has changed between two results of one place.

    Points decide what has changed, outlines of what: classes and heights of both surveys are compared in
    cells, less the offset between them, and what differs by more than points and outlines are sure of is a
    change, see `judge_cells`. Memory grows with the buildings' area. InputError if one is no output folder
    with `buildings.gpkg` and `classified/`, or both lie in different reference systems or apart.
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
    scale = next((scale_of(side) for side in sides if len(side.polygons)), 1.0)
    sides = scaled(sides[0], scale), scaled(sides[1], scale)
    polygons = np.concatenate([side.polygons for side in sides])
    if not len(polygons):
        return Comparison(*sides, [], ([], []), 0.0, 0.0, _SMALLEST_CELL)
    spacing = max(_median(side, "point_spacing") for side in sides)
    cell = max(_SMALLEST_CELL, math.ceil(_CELL_SPACINGS * spacing / _CELL_STEP) * _CELL_STEP)
    plan = CellPlan.around(polygons, cell, _MARGIN)
    before, after = (see(plan, read_class_chunks(path, scale)) for path in (old, new))
    rises = rises_of(plan, before, after)
    least = max(config.min_height, _SURE * rises.scatter)
    limits = Limits(least, config.min_area, config.min_storey)
    cells = judge_cells(plan, before, after, rises, limits)
    outlines = sides[0].polygons, sides[1].polygons
    changes, words = judge_buildings(
        cells, outlines, rises.scatter, (_roof_sigmas(sides[0]), _roof_sigmas(sides[1]))
    )
    return Comparison(*sides, changes, words, rises.offset, rises.scatter, cell)


def _roof_sigmas(side: MetricPolygons) -> NDArray[np.float64]:
    """
    Return how sure the height of each roof is, 0 if that is not known [m].

    Of a least-squares plane the variance is 3 s² / n in the mean over its n points, which scatter by s, and
    more as neighbours share errors (`plane_covariances`). Corners have no part in it: heights are compared
    amid roofs, and what walls are inside of the eaves both surveys share.
    """
    n_planes, n_points, scatter = (
        np.asarray(side.attributes.get(name, np.zeros(len(side.polygons))), dtype=np.float64)
        for name in ("n_planes", "n_points", "plane_sigma")
    )
    variance = 3.0 * POINTS_SHARED * n_planes / np.maximum(n_points, 1.0) * (scatter * side.unit) ** 2
    return np.asarray(np.sqrt(np.nan_to_num(variance)))


def _median(side: MetricPolygons, name: str) -> float:
    values = np.asarray(side.attributes.get(name, ()), dtype=np.float64) * side.unit
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else 0.0


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
        f"{counted(len(found.old.polygons), 'building')} before, {len(found.new.polygons)} now; NEW lies "
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
