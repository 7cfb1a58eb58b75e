"""What two surveys saw in the cells of a plan, and what became of each cell."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.neighbours.union_find import sets_of_pairs
from lidar_buildings.evaluation.scores.cells import CellSet, cell_centres, cells_of_polygons, keys_of

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

    def moved(self, rise: float) -> Surfaces:
        """Return what was seen, moved upwards [m]."""
        return Surfaces(*(one + rise for one in self))

    def around(self, plan: CellPlan, kind: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the least and greatest elevation of a kind in a cell and those next to it."""
        low, high = getattr(self, f"{kind}_low"), getattr(self, f"{kind}_high")
        return plan.about(low, np.inf).min(axis=0), plan.about(high, -np.inf).max(axis=0)

    def slope(self, plan: CellPlan) -> NDArray[np.float64]:
        """Return the slope of roofs that go on straight to all sides; NaN elsewhere."""
        about, steps = plan.about(self.roof, np.nan), []
        for before, after in ((about[1], about[7]), (about[3], about[5])):
            bend = np.abs(before + after - 2.0 * self.roof)
            steps.append(np.where(bend <= _MAX_BEND, 0.5 * (after - before), np.nan))
        return np.hypot(*steps) / plan.size


def see(plan: CellPlan, chunks: Iterable[tuple[NDArray[Any], ...]]) -> Surfaces:
    """Return what a survey saw, of chunks of points [m], classes, and façade marks of those of buildings."""
    n = len(plan.cells)
    counts, sums = np.zeros((2, 2, n))
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
        is_other = is_seen & ~is_roof & ~is_ground & ~is_facade
        for (low, high), rows in zip(ends, (is_roof, is_other), strict=True):
            np.minimum.at(low, cell[rows], points[rows, 2])
            np.maximum.at(high, cell[rows], points[rows, 2])
    roof, ground = np.where(counts > 0, sums / np.maximum(counts, 1.0), np.nan)
    return Surfaces(roof, *ends[0], *ends[1], ground)


#: What becomes of a cell.
SAME, UNSEEN, BUILT, REMOVED, HIGHER, LOWER = range(6)
#: A roof goes on straight from cell to cell up to this: twice the noise of means and some roughness [m].
_MAX_BEND = 0.2
#: What lies within this in a cell is one roof, though it ends there [m].
_MAX_SPREAD = 0.3


class Limits(NamedTuple):
    """From when on a difference is a change."""

    height: float  #: of a roof's elevation [m]
    area: float  #: of a part of a roof [m²]
    storey: float  #: of a roof above ground that was free before [m]
    shift: float  #: by how much a roof may lie elsewhere, as outlines and cells are known no better [m]


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


def offset_of(old: Surfaces, new: Surfaces) -> tuple[float, float]:
    """
    Return by how much a survey lies above another, and the scatter of what has not changed [m].

    The offset is the median over ground that both have seen, or over roofs if there is none: a few houses
    that were raised are no offset. The scatter is that of single cells of roofs or ground about their
    medians, whichever is larger, as most of a place has not changed.
    """
    found = []
    for away in (new.ground - old.ground, new.roof - old.roof):
        known = away[np.isfinite(away)]
        if len(known):
            middle = float(np.median(known))
            found.append((middle, 1.4826 * float(np.median(np.abs(known - middle)))))
    return (found[0][0], max(one[1] for one in found)) if found else (0.0, 0.0)


def judge_cells(plan: CellPlan, old: Surfaces, new: Surfaces, offset: float, limits: Limits) -> CellChanges:
    """
    Tell what became of each cell; `offset` is by how much the new survey lies above the old one [m].

    On a smooth roof a cell has changed by the difference of both means, less what the slope makes of a shift
    in plan. Elsewhere all that is seen of its roof has to lie beyond all that the other survey has seen of
    roofs in the cells around: an edge that lies somewhat elsewhere is no change (as Murakami and others 1999,
    who shrink and expand differences), nor are wires above; but cells that have changed in the mean go with
    those beside them that have for sure. A roof is built where the other survey has seen ground and no roof
    around, nor anything else at its height: what is only classified otherwise is no change, and what one
    survey has not seen, behind a wall, is not told.
    """
    before, after = old, new.moved(-offset)
    state, height = np.full(len(plan.cells), UNSEEN, dtype=np.int8), np.zeros(len(plan.cells))
    for one, other, kind, sign in ((after, before, BUILT, 1.0), (before, after, REMOVED, -1.0)):
        has_roof = np.isfinite(one.roof)
        rise = one.roof - other.roof
        state[np.isfinite(rise) & (state == UNSEEN)] = SAME
        own, sloped = one.slope(plan), other.slope(plan)
        is_plain = np.isfinite(own) | (one.roof_high - one.roof_low <= _MAX_SPREAD)
        low, high = other.around(plan, "roof")
        gap = _gap(one.roof_low, one.roof_high, low, high)
        away = np.abs(rise) - np.fmax(own, sloped) * limits.shift
        is_sure = np.where(np.isfinite(sloped) & is_plain, away, np.abs(gap)) > limits.height
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


def _gap(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    other_low: NDArray[np.float64],
    other_high: NDArray[np.float64],
) -> NDArray[np.float64]:
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
