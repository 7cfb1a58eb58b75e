"""What a method looks for roofs among, the same for all methods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.columns import Columns, gathered
from lidar_buildings.core.surfaces.surface_patches import connected_columns, plan_areas

#: Smallest radius of a neighbourhood, in spacings: sixteen points on an even surface, where planes take six.
RADIUS_SPACINGS = 2.25
#: The same where the cloud is dense: the scale at which foliage is no longer flat [m].
MIN_RADIUS = 0.75
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

    A method returns which of them are roof, small buildings dropped by `of_buildings`.
    """

    columns: Columns  #: points from `min_height` on; the other arrays are in their order
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
    def cells(self) -> Columns:
        """Which points lie in each cell, few of which stay empty on a surface; no second copy of them."""
        return replace(gathered(self.points, self.cell), points=np.empty((0, 3)))

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

    def areas(self, label: NDArray[np.int64], n_labels: int) -> NDArray[np.float64]:
        """Return the area of the cells that the points of each label occupy [m²]; −1 is none."""
        return plan_areas(label[self.cells.rows], n_labels, self.cells.first, self.cell)

    def buildings(self, roof: NDArray[np.bool_], min_area: float) -> tuple[NDArray[np.int64], int]:
        """Return the building of each roof point, −1 for others and those of less area in plan [m²]."""
        rows = np.flatnonzero(roof)
        label, n = self.parts(rows, self.radius, in_plan=True)
        label[rows[(self.areas(label, n) < min_area)[label[rows]]]] = -1
        return label, n

    def of_buildings(self, roof: NDArray[np.bool_], min_area: float) -> NDArray[np.bool_]:
        """Tell which roof points are of buildings in plan with so much area [m²]."""
        return np.asarray(self.buildings(roof, min_area)[0] >= 0)
