"""Courtyards: which gaps inside an outer ring count as one, and the width of the roof round them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.outline import signed_area
from lidar_buildings.core.stages.boundary_tracing.point_grid import PointGrid

#: A roof that is narrow along more of a courtyard's rim than this is the rim of a roof without returns.
_MAX_NARROW_SHARE = 0.5


@dataclass(frozen=True)
class CourtyardRules:
    """What makes a gap between roof points a courtyard."""

    radius: float  #: of the disc that has to fit in [m]
    min_area: float  #: smallest area [m²]
    min_band: float  #: width of the roof round most of it [m]

    def refusal(self, ring: NDArray[np.float64], narrow_share: float) -> str | None:
        """
        Say why the place inside a ring is no courtyard; nothing to say of small ones, None if it is one.

        `narrow_share` of its rim has a roof round it that is narrower than `min_band`.
        """
        if abs(signed_area(ring)) < self.min_area:
            return ""
        if narrow_share > _MAX_NARROW_SHARE:
            return "only the rim of the roof has points: the empty place inside is taken for roof"
        return None


def narrow_share(
    grid: PointGrid, hole: NDArray[np.int64], exterior: NDArray[np.int64], width: float
) -> float:
    """
    Return the share of a courtyard's rim along which the outer ring is nearer than a width.

    Distances are those between vertices, and each vertex of the rim stands for half of its two edges. The
    width is in half sides of the neighbourhood.
    """
    u, v = grid.ux * grid.x + grid.uy * grid.y, grid.vx * grid.x + grid.vy * grid.y
    rim, outer = np.column_stack((u[hole], v[hole])), np.column_stack((u[exterior], v[exterior]))
    distance, _ = cKDTree(outer).query(rim, p=2 if grid.is_disc else np.inf)
    edge = np.hypot(grid.x[hole] - np.roll(grid.x[hole], 1), grid.y[hole] - np.roll(grid.y[hole], 1))
    length = edge + np.roll(edge, -1)
    return float(length[distance <= width].sum() / length.sum())
