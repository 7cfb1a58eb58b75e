"""Borders between the parts of a building, and what parts go back to their neighbours."""

from __future__ import annotations

import heapq
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import rows_by_cell
from lidar_buildings.core.neighbours.windows import first_from
from lidar_buildings.core.stages.segmentation.part_shape import rectangle_width, spread_width

#: A part with less than this share of its perimeter in the open stands on another roof, and is a building of
#: its own, not a penthouse or plant room, from this area on [m²].
MIN_FREE_SHARE, MIN_TOWER_AREA = 0.1, 100.0
#: A perimeter counted in cell sides is longer than the line itself by 4/π, on average over directions.
STAIRS = 1.27


class Borders(NamedTuple):
    """Lengths of borders."""

    free: NDArray[np.float64]  #: perimeter in the open [m], shape (n_parts,)
    shared: dict[tuple[int, int], float]  #: (part, other part) → length of their border [m], both ways round


def measure_borders(
    points: NDArray[np.float64], part: NDArray[np.int64], n_parts: int, cell: float
) -> Borders:
    """
    Measure the borders of parts from the cells that they occupy.

    A cell, counted from (0, 0), is the part's that has most points in it. A side between two parts' cells is
    on their border, one beside two empty cells is in the open; a single empty one is a gap between points. A
    part that has most points in no cell lies amid those that have.
    """
    cells = rows_by_cell(points, cell)
    owner, one, other = _owners(part, cells.rows, cells.first)
    code = np.concatenate(
        (_sides(owner, cells.numbers, cells.n_columns, n_parts), *_within(owner, one, other, n_parts))
    )
    pairs, n_sides = np.unique(code, return_counts=True)
    first, second = np.divmod(pairs, n_parts + 1)
    scale = cells.size / STAIRS
    is_free = second == n_parts
    free = scale * np.bincount(first[is_free], weights=n_sides[is_free], minlength=n_parts).astype(float)
    shared = {
        (int(a), int(b)): float(n) * scale
        for a, b, n in zip(first[~is_free], second[~is_free], n_sides[~is_free], strict=True)
    }
    return Borders(free, shared)


def _within(
    owner: NDArray[np.int64], part: NDArray[np.int64], cell: NDArray[np.int64], n_parts: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Return the codes of the borders of parts that own no cell with the owners of those they have points in.
    """
    has_cell = np.zeros(n_parts, dtype=np.bool_)
    has_cell[owner] = True
    amid = ~has_cell[part]
    inner, outer = part[amid], owner[cell[amid]]
    return inner * (n_parts + 1) + outer, outer * (n_parts + 1) + inner


@kernel
def _owners(part, rows, first):  # type: ignore[no-untyped-def]
    """
    Return the part with most points of every cell, the last of equals, and all (part, cell) with points.
    """
    owner = np.empty(len(first) - 1, dtype=np.int64)
    number, place = np.empty(len(rows), dtype=np.int64), np.empty(len(rows), dtype=np.int64)
    n = 0
    for cell in range(len(owner)):
        members = np.sort(part[rows[first[cell] : first[cell + 1]]])
        most, count = 0, 0
        for k in range(len(members)):
            count = count + 1 if k > 0 and members[k] == members[k - 1] else 1
            if count == 1:
                number[n], place[n] = members[k], cell
                n += 1
            if count >= most:
                most, owner[cell] = count, members[k]
    return owner, number[:n].copy(), place[:n].copy()


@kernel
def _sides(owner, numbers, n_columns, n_parts):  # type: ignore[no-untyped-def]
    """Return a code, part · (n_parts + 1) + part beside it, or n_parts where it is open, of every side."""
    codes = np.empty(4 * len(owner), dtype=np.int64)
    n = 0
    for cell in range(len(owner)):
        for step in (1, -1, n_columns, -n_columns):
            beside = _beside(numbers, cell, step, n_columns)
            other = owner[beside] if beside >= 0 else n_parts
            if other != owner[cell]:
                codes[n] = owner[cell] * (n_parts + 1) + other
                n += 1
    return codes[:n].copy()


@kernel
def _beside(numbers, cell, step, n_columns):  # type: ignore[no-untyped-def]
    """Return the next occupied cell, one or two steps off, −1 if both are empty."""
    column = numbers[cell] % n_columns
    for far in (1, 2):
        if abs(step) == 1 and not 0 <= column + far * step < n_columns:
            return -1
        wanted = numbers[cell] + far * step
        found = first_from(numbers, wanted)
        if found < len(numbers) and numbers[found] == wanted:
            return found
    return -1


def merge_parts(
    borders: Borders,
    area: NDArray[np.float64],
    block: NDArray[np.int64],
    *,
    min_area: float,
    min_width: float,
    sums: NDArray[np.float64] | None = None,
) -> NDArray[np.int64]:
    """
    Return into which part each part goes, the smallest first; a part that stays goes into itself.

    A part goes if it is smaller or narrower (the rectangle of its area and perimeter) than a building, or
    than a tower if nearly all of its rim is another's; it goes to the part of its block with which it shares
    the longest border, and where there is none to the largest. If `sums` are given, see
    `part_shape.plan_sums`, a part's points must scatter as over the least width, too.
    """
    parts = _Parts(borders, area, block, sums)
    into = np.arange(len(area))
    waiting = [(float(one), number) for number, one in enumerate(area)]
    heapq.heapify(waiting)
    while waiting:
        size, number = heapq.heappop(waiting)
        if into[number] != number or size != parts.area[number]:
            continue
        if parts.is_building(number, min_area, min_width):
            continue
        target = parts.neighbour(number)
        if target is None:
            continue
        parts.merge(number, target)
        into[number] = target
        heapq.heappush(waiting, (parts.area[target], target))
    for number in range(len(into)):
        while into[into[number]] != into[number]:
            into[number] = into[into[number]]
    return into


class _Parts:
    """Parts while they merge."""

    def __init__(
        self,
        borders: Borders,
        area: NDArray[np.float64],
        block: NDArray[np.int64],
        sums: NDArray[np.float64] | None,
    ) -> None:
        self.area = area.tolist()
        self.sums = None if sums is None else sums.copy()
        self.free = borders.free.tolist()
        self.block = block.tolist()
        self.members: dict[int, set[int]] = {}
        self.shared: list[dict[int, float]] = [{} for _ in self.area]
        for number, one in enumerate(self.block):
            self.members.setdefault(one, set()).add(number)
        for (one, other), length in sorted(borders.shared.items()):
            if self.block[one] == self.block[other]:
                self.shared[one][other] = length
            else:
                self.free[one] += length

    def is_building(self, number: int, min_area: float, min_width: float) -> bool:
        """Whether a part is large, wide and free enough to be one."""
        perimeter = self.free[number] + sum(self.shared[number].values())
        is_free = self.free[number] >= MIN_FREE_SHARE * perimeter
        is_large = self.area[number] >= (min_area if is_free else max(min_area, MIN_TOWER_AREA))
        if not is_large or rectangle_width(self.area[number], perimeter) < min_width:
            return False
        return self.sums is None or spread_width(self.sums[number]) >= min_width

    def neighbour(self, number: int) -> int | None:
        """Return the part with the longest border, or else the largest of the block; the first of equals."""
        shared = self.shared[number]
        if shared:
            return max(shared, key=lambda other: (shared[other], self.area[other], -other))
        others = self.members[self.block[number]] - {number}
        return max(others, key=lambda other: (self.area[other], -other)) if others else None

    def merge(self, number: int, target: int) -> None:
        """Count a part to another."""
        self.area[target] += self.area[number]
        if self.sums is not None:
            self.sums[target] += self.sums[number]
        self.free[target] += self.free[number]
        self.members[self.block[number]].discard(number)
        for other, length in self.shared[number].items():
            del self.shared[other][number]
            if other != target:
                for one, two in ((target, other), (other, target)):
                    self.shared[one][two] = self.shared[one].get(two, 0.0) + length
