"""How many buildings of a reference a result covers, whatever the outlines they were found in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.evaluation.scores.polygons import MIN_INSIDE, cut_to, limits_of, valid_polygons
from lidar_buildings.evaluation.scores.statistics import ratio

#: A building counts as covered from this share of its area on.
MIN_COVERED = 0.5


@dataclass(frozen=True, eq=False)
class CoverageScore:
    """
    Buildings of the reference under the result; a share of nothing is NaN.

    Attributes
    ----------
    n_buildings : int
        Reference buildings that count, touching ones each for itself.
    n_covered : int
        Those of which at least half the area lies in the result.
    covered_share : float
        Covered / counted.
    covered : ndarray of float, shape (n_given_reference,)
        Share of each given building's area that lies in the result.
    """

    n_buildings: int
    n_covered: int
    covered_share: float
    covered: NDArray[np.float64]


def score_coverage(
    result: ArrayLike, reference: ArrayLike, *, area: ArrayLike | None = None
) -> CoverageScore:
    """
    Count the reference buildings that lie under the union of all result outlines.

    Parameters
    ----------
    result, reference : array_like of shapely.Polygon or MultiPolygon
        One geometry per building [m]; invalid ones are repaired.
    area : array_like of shapely.Polygon or MultiPolygon, optional
        Where the reference is complete; buildings are cut to it, and those mostly outside do not count.

    Returns
    -------
    CoverageScore
    """
    theirs, inside = cut_to(valid_polygons(reference), limits_of(area))
    size = shapely.area(theirs)
    common = shapely.area(shapely.intersection(theirs, shapely.union_all(valid_polygons(result))))
    covered = np.divide(common, size, out=np.zeros(len(theirs)), where=size > 0)
    counted = inside >= MIN_INSIDE
    n_buildings = int(np.count_nonzero(counted))
    n_covered = int(np.count_nonzero(counted & (covered >= MIN_COVERED)))
    return CoverageScore(n_buildings, n_covered, ratio(n_covered, n_buildings), covered)
