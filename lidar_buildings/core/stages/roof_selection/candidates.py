"""What a method looks for roofs among, and what lies around each point or column."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.cell_grid import CellGrid, rows_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.point_spacing import (
    MAX_SPARSER,
    MIN_SPARSER,
    group_spacings,
    rounded_spacing,
)
from lidar_buildings.core.neighbours.sectors import sector_of
from lidar_buildings.core.surfaces.surface_patches import connected_columns, plan_areas

#: Smallest radius of a neighbourhood, in spacings: sixteen points on an even surface, where planes take six.
RADIUS_SPACINGS = 2.25
#: The same where the cloud is dense: the scale at which foliage is no longer flat [m].
MIN_RADIUS = 0.75
#: Cells in which areas are counted, in spacings: four points each, so that few cells of a roof stay empty.
AREA_CELL = 2.0
#: Points that rise above ground are of one part, with a spacing of its own, if so near in plan [spacings].
PART_STEP = 4.5
#: Columns of points across a radius: what their neighbours are found by.
COLUMNS_A_RADIUS = 2.0
#: Steepest roof: between spires and walls [deg].
MAX_SLOPE_DEG = 80.0
#: Largest angle between the normals of neighbours on one roof: smooth at `max_roughness`, and no ridge [deg].
MAX_ANGLE_DEG = 15.0


@dataclass(frozen=True, eq=False)
class Candidates:
    """
    The points that rise above ground, and what a method may want to know of them.

    A method returns which of them are roof; small buildings are dropped by `buildings`.
    """

    columns: CellGrid  #: points from `min_height` on; the other arrays are in their order
    #: Whether the pulse ended there, and whether that is all that came back of it, shape (n_points,).
    is_last: NDArray[np.bool_]
    is_only: NDArray[np.bool_]
    #: Takes ground and what is lower than half of `min_height` out of the cloud [m], shape (n_ground, 3).
    ground: Callable[[], NDArray[np.float64]]
    radius: float  #: smallest radius of a neighbourhood, and longest step within a surface [m]
    cell: float  #: side of the cells in which areas are counted, two spacings [m]

    @property
    def points(self) -> NDArray[np.float64]:
        """The points column by column [m]."""
        return self.columns.points

    @cached_property
    def cells(self) -> CellGrid:
        """Which points lie in each cell, few of which stay empty on a surface; no second copy of them."""
        return rows_by_cell(self.points, self.cell)._replace(points=np.empty((0, 3)))

    def parts(
        self, rows: NDArray[np.integer], step: float, *, in_plan: bool = False
    ) -> tuple[NDArray[np.int64], int]:
        """Return the parts that steps of a length [m] connect some points to, −1 for others; how many."""
        chosen = np.zeros(len(self.points), dtype=bool)
        chosen[rows] = True
        part = connected_columns(self.columns.select(chosen), step, in_plan=in_plan)
        label = np.full(len(self.points), -1)
        label[chosen] = part
        return label, label.max(initial=-1) + 1

    def by_spacing(self, spacing: float) -> Iterator[tuple[NDArray[np.bool_], Candidates]]:
        """
        Yield the points of parts that are as dense as the cloud, and those of sparser ones by their spacing.

        Under one strip alone, dark or turned away, a roof may be sparser than ground under two. What lets the
        ground below be seen is as dense as both together.
        """
        label, n = self.parts(np.arange(len(self.points)), PART_STEP * spacing, in_plan=True)
        every = np.concatenate([self.points, self.ground()])
        cells = rows_by_cell(every, 0.5 * MAX_SPARSER * spacing)
        part = np.concatenate([label, np.full(len(every) - len(label), -1)])
        above = np.maximum.reduceat(part[cells.rows], cells.first[:-1])[cells.cell] if len(every) else part
        part[cells.rows] = np.where(part[cells.rows] < 0, above, part[cells.rows])
        own = group_spacings(every, cells, part, n)
        own = np.where(own > MIN_SPARSER * spacing, np.minimum(own, MAX_SPARSER * spacing), 0.0)
        rounded = np.array([rounded_spacing(one) if one else spacing for one in own.tolist()])
        for one in np.unique(rounded).tolist():
            chosen = (rounded == one)[label]
            found = replace(self, radius=max(RADIUS_SPACINGS * one, MIN_RADIUS), cell=AREA_CELL * one)
            if not chosen.all():
                own_columns = self.columns.select(chosen)
                last, only = self.is_last[chosen], self.is_only[chosen]
                found = replace(found, columns=own_columns, is_last=last, is_only=only)
            yield chosen, found

    def areas(self, label: NDArray[np.int64], n_labels: int) -> NDArray[np.float64]:
        """Return the area of the cells that the points of each label occupy [m²]; −1 is none."""
        return plan_areas(label[self.cells.rows], n_labels, self.cells.first, self.cell)

    def buildings(self, roof: NDArray[np.bool_], min_area: float) -> tuple[NDArray[np.int64], int]:
        """Return the building of each roof point, −1 for others and those of less area in plan [m²]."""
        rows = np.flatnonzero(roof)
        label, n = self.parts(rows, self.radius, in_plan=True)
        label[rows[(self.areas(label, n) < min_area)[label[rows]]]] = -1
        return label, n


#: Points more nearly on a line than this span no plane: cables, single scan lines.
MAX_LINEARITY = 0.95
#: Columns a block of work.
BLOCK = 32_768


class Surroundings(NamedTuple):
    """What stands within reach of each column's middle in plan, told by whole columns."""

    n_sectors: NDArray[np.uint8]  #: sectors of eight that show some, shape (n_columns,)
    #: The ends of its elevations [m]; infinite the wrong way round where there is nothing, shape
    #: (n_columns,).
    lowest: NDArray[np.float64]
    highest: NDArray[np.float64]


def near_tangent_plane(
    columns: CellGrid,
    normals: NDArray[np.float64],
    is_surface: NDArray[np.bool_],
    radius: float,
    max_distance: float,
) -> NDArray[np.bool_]:
    """
    Tell which points lie on the surface or its immediate continuation.

    `normals` are those of the surface points alone; the surface goes on beyond these by the radius, and a
    point may be `max_distance` from the tangent plane of one within it [m].
    """
    return _joined(columns, columns.select(is_surface), normals, is_surface, radius, max_distance, 1.0)


def near_in_plan(columns: CellGrid, targets: NDArray[np.bool_], reach: float) -> NDArray[np.bool_]:
    """Tell which points are targets or lie within reach of one in plan [m]."""
    near = columns.select(targets)
    return _joined(columns, near, near.points, targets, reach, np.inf, 0.0)


def _joined(
    columns: CellGrid,
    surface: CellGrid,
    normals: NDArray[np.float64],
    is_surface: NDArray[np.bool_],
    radius: float,
    max_distance: float,
    upright: float,
) -> NDArray[np.bool_]:
    joined, asking = is_surface.copy(), columns.holding(~is_surface)
    own, other = (columns.points, columns.first), (surface.points, surface.first, normals)
    limits = radius, max_distance, upright

    def join(begin: int, end: int) -> None:
        runs = columns.around(radius, asking[begin:end])
        _join(*own, *other, asking[begin:end], runs, *limits, joined)

    for_row_blocks(join, len(asking), BLOCK)
    return joined


def surroundings(
    columns: CellGrid, chosen: NDArray[np.bool_], reach: float, wanted: NDArray[np.bool_]
) -> Surroundings:
    """
    Look at the chosen points around those columns that hold wanted points; for others there is no answer.

    Whole columns are within reach if their middles are: to within half a column, as many times faster as
    there are points in one.
    """
    rows, first, asking = np.flatnonzero(chosen), columns.first_of(chosen), columns.holding(wanted)
    is_held = np.diff(first, append=first[-1]) > 0
    holds = np.flatnonzero(is_held)
    before: NDArray[np.int64] = np.cumsum(is_held) - is_held
    own = columns.places
    place = own[holds]
    lowest, highest = (columns.points[rows[at], 2] for at in (first[holds], first[holds + 1] - 1))
    n = len(columns.numbers)
    found = Surroundings(np.zeros(n, dtype=np.uint8), np.full(n, np.inf), np.full(n, -np.inf))
    known = before, place, lowest, highest, reach / columns.size

    def look_around(begin: int, end: int) -> None:
        runs = columns.around(reach, asking[begin:end])
        _look_around(asking[begin:end], own, runs, *known, *found)

    for_row_blocks(look_around, len(asking), BLOCK)
    return found


@kernel
def _join(  # type: ignore[no-untyped-def]
    points, first, surface, surface_first, normals, asking, runs, radius, max_distance, upright, joined
):
    for one in range(len(asking)):
        for i in range(first[asking[one]], first[asking[one] + 1]):
            if joined[i]:
                continue
            x, y, z = points[i]
            for row in range(runs.shape[1]):
                west, east = runs[one, row]
                for j in range(surface_first[west], surface_first[east]):
                    dx, dy, dz = surface[j, 0] - x, surface[j, 1] - y, upright * (surface[j, 2] - z)
                    off = normals[j, 0] * dx + normals[j, 1] * dy + normals[j, 2] * dz
                    if dx * dx + dy * dy + dz * dz <= radius * radius and abs(off) <= max_distance:
                        joined[i] = True
                        break
                if joined[i]:
                    break


@kernel
def _look_around(asking, own, runs, before, place, lowest, highest, reach, n_sectors, low, high):  # type: ignore[no-untyped-def]
    for one in range(len(asking)):
        k, seen = asking[one], 0
        for row in range(runs.shape[1]):
            for j in range(before[runs[one, row, 0]], before[runs[one, row, 1]]):
                dx, dy = place[j, 1] - own[k, 1], place[j, 0] - own[k, 0]
                if dx * dx + dy * dy > reach * reach:
                    continue
                low[k], high[k] = min(low[k], lowest[j]), max(high[k], highest[j])
                if dx != 0 or dy != 0:
                    seen |= 1 << sector_of(float(dx), float(dy))
        while seen:
            n_sectors[k] += seen & 1
            seen >>= 1
