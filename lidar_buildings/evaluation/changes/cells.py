"""From what two surveys saw to what became of each cell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.evaluation.changes.surfaces import CellBlock, CellPlan, Surfaces
from lidar_buildings.evaluation.scores.cells import cell_centres, cells_of_polygons

#: What becomes of a cell.
SAME, UNSEEN, BUILT, REMOVED, HIGHER, LOWER = range(6)
#: A roof goes on straight from cell to cell up to this: twice the noise of means and some roughness [m].
_MAX_BEND = 0.2
#: What lies within this in a cell is one roof, though it ends there [m].
_MAX_SPREAD = 0.3
#: Cells along the side of the blocks that are judged at a time, and around them: parts that reach farther are
#: hardly any.
_BLOCK_SIDE, _MARGIN = 1000, 64
#: Cells around that are next to one, and the least that a part has of them together.
_AROUND, _BLOCK = np.ones((3, 3), dtype=bool), np.ones((2, 2), dtype=bool)


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
    state, height = np.full(len(plan.cells), UNSEEN, dtype=np.int8), np.zeros(len(plan.cells))
    margin = max(_MARGIN, math.ceil(0.5 * limits.area / plan.size**2))
    for block in plan.blocks(_BLOCK_SIDE, margin):
        seen = (_Raster.of(block, old, 0.0), _Raster.of(block, new, -offset))
        found = _judge_block(*seen, plan.size, limits)
        state[block.own], height[block.own] = (one[block.places][block.is_own] for one in found)
    return CellChanges(plan, state, height, limits.area)


def _judge_block(
    before: _Raster, after: _Raster, size: float, limits: Limits
) -> tuple[NDArray[np.int8], NDArray[np.float64]]:
    """Return the states and heights of a block's cells."""
    state, height = np.full(before.roof.shape, UNSEEN, dtype=np.int8), np.zeros(before.roof.shape)
    for one, other, kind, sign in ((after, before, BUILT, 1.0), (before, after, REMOVED, -1.0)):
        around = other.around()
        has_roof = np.isfinite(one.roof)
        rise = one.roof - other.roof
        state[np.isfinite(rise) & (state == UNSEEN)] = SAME
        own, sloped = one.slope(size), other.slope(size)
        is_plain = np.isfinite(own) | (one.roof_high - one.roof_low <= _MAX_SPREAD)
        gap = _gap(one.roof_low, one.roof_high, around.roof_low, around.roof_high)
        away = np.abs(rise) - np.fmax(own, sloped) * limits.shift
        is_sure = np.where(np.isfinite(sloped) & is_plain, away, np.abs(gap)) > limits.height
        is_more = ndimage.binary_propagation(is_sure, _AROUND, is_sure | (away > limits.height))
        is_more &= np.isfinite(rise)
        height[is_more] = sign * rise[is_more]
        state[is_more] = np.where(height[is_more] > 0.0, HIGHER, LOWER)
        storey = one.roof - other.ground
        is_free = has_roof & (around.roof_low > around.roof_high) & np.isfinite(storey)
        is_other = _gap(one.roof, one.roof, around.other_low, around.other_high) == 0.0
        is_built = is_free & (storey >= limits.storey) & ~is_other
        state[is_built], height[is_built] = kind, sign * storey[is_built]
        state[has_roof & (is_free | is_other) & (state == UNSEEN)] = SAME
    for kind in (BUILT, REMOVED, HIGHER, LOWER):
        _drop_small(state, kind, limits.area / size**2)
    return state, height


class _Raster(NamedTuple):
    """What one survey saw in a block of cells, as rasters; NaN where nothing."""

    roof: NDArray[np.float64]
    roof_low: NDArray[np.float64]
    roof_high: NDArray[np.float64]
    other_low: NDArray[np.float64]
    other_high: NDArray[np.float64]
    ground: NDArray[np.float64]

    @classmethod
    def of(cls, block: CellBlock, seen: Surfaces, shift: float) -> _Raster:
        """Fill the rasters of a block, all moved upwards by a shift [m]."""
        rasters = []
        for name in cls._fields:
            raster = np.full(block.shape, np.nan)
            raster[block.places] = getattr(seen, name)[block.cells] + shift
            rasters.append(raster)
        return cls(*rasters)

    def around(self) -> _Raster:
        """Return the least and greatest of a cell and those next to it; where none has any infinite ones."""
        lows = [
            ndimage.minimum_filter(np.where(np.isfinite(one), one, np.inf), 3)
            for one in (self.roof_low, self.other_low)
        ]
        highs = [
            ndimage.maximum_filter(np.where(np.isfinite(one), one, -np.inf), 3)
            for one in (self.roof_high, self.other_high)
        ]
        return _Raster(self.roof, lows[0], highs[0], lows[1], highs[1], self.ground)

    def slope(self, size: float) -> NDArray[np.float64]:
        """Return the slope of roofs that go on straight to all sides; NaN elsewhere."""
        steps = []
        for axis in (0, 1):
            before, after = np.roll(self.roof, 1, axis), np.roll(self.roof, -1, axis)
            bend = np.abs(before + after - 2.0 * self.roof)
            steps.append(np.where(bend <= _MAX_BEND, 0.5 * (after - before), np.nan))
        return np.hypot(*steps) / size


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


def _drop_small(state: NDArray[np.int8], kind: int, least: float) -> None:
    """Leave of a kind only parts of some cells, of blocks of two by two."""
    is_kind = state == kind
    kept = ndimage.binary_opening(is_kind, _BLOCK)
    label, n = ndimage.label(kept, _AROUND)
    large = np.append(False, np.bincount(label.ravel(), minlength=n + 1)[1:] >= least)
    state[is_kind & ~large[label]] = SAME
