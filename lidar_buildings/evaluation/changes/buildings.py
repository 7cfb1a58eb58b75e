"""From what became of cells to what has changed of which building."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.evaluation.changes.cells import BUILT, HIGHER, LOWER, REMOVED, UNSEEN, CellChanges

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
    """Return the area of cells, of their south-western corners."""
    x, y = corners.T
    return shapely.union_all(shapely.box(x, y, x + size, y + size))
