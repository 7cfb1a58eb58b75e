"""How far roof points lie from the roofs of building models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.evaluation.scores.roof_surfaces import Solids, roof_surfaces
from lidar_buildings.evaluation.scores.statistics import mean, percentile, ratio, root_mean_square

#: The distances within which points are counted [m].
WITHIN = (0.1, 0.2, 0.5)
#: A building with fewer points has no RMSE; wide margin: roofs have hundreds.
MIN_POINTS = 10


@dataclass(frozen=True, eq=False)
class ModelPointScore:
    """Vertical distances of points to roofs, see `doc/scores.md`; a share or mean of nothing is NaN."""

    n_points: int
    uncovered: float
    median: float
    bias: float
    rmse: float
    within: tuple[float, ...]  #: shares of the points within 0.1, 0.2 and 0.5 m of the roof
    building_rmse_median: float
    building_rmse_95: float
    n_buildings: int
    rmse_per_building: NDArray[np.float64]  #: NaN with fewer than ten points [m], shape (n_given_buildings,)


def score_model_points(buildings: Sequence[Solids], points: ArrayLike) -> ModelPointScore:
    """Measure how far roof points lie above or below the roof at their place, and whose roof that is."""
    cloud = checked_points(points)
    building, elevation = roof_surfaces(buildings).over(cloud)
    is_on = building >= 0
    distance = (cloud[:, 2] - elevation)[is_on]
    per_building = _rmse_per_building(distance, building[is_on], len(buildings))
    known = per_building[np.isfinite(per_building)]
    return ModelPointScore(
        n_points=len(cloud),
        uncovered=ratio(len(cloud) - len(distance), len(cloud)),
        median=percentile(np.abs(distance), 50),
        bias=mean(distance),
        rmse=root_mean_square(distance),
        within=tuple(
            ratio(int(np.count_nonzero(np.abs(distance) <= limit)), len(distance)) for limit in WITHIN
        ),
        building_rmse_median=percentile(known, 50),
        building_rmse_95=percentile(known, 95),
        n_buildings=len(known),
        rmse_per_building=per_building,
    )


def _rmse_per_building(
    distance: NDArray[np.float64], building: NDArray[np.int64], n_buildings: int
) -> NDArray[np.float64]:
    """Return the root of each building's mean square distance [m], NaN with few points."""
    count = np.bincount(building, minlength=n_buildings)
    squares = np.bincount(building, distance**2, minlength=n_buildings)
    mean_square = np.divide(squares, count, out=np.full(n_buildings, np.nan), where=count >= MIN_POINTS)
    return np.sqrt(mean_square)
