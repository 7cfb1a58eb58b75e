"""How well the planes of roofs agree with a reference, point by point: each plane is an instance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.point_array import checked_column, checked_points
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.surfaces.surface_patches import connected_parts
from lidar_buildings.evaluation.scores.cells import ratio

#: Intersection over union from which on two planes are the same (Everingham et al. 2010, PASCAL VOC).
MIN_IOU = 0.5
#: Parts of a colour this near to one another are one plane [m], or so many point spacings if that is more.
PART_GAP, PART_GAP_SPACINGS = 1.0, 3.0
#: Parts that stand for less area than this [m²], or of fewer points, are labelling errors: of no plane.
MIN_PART_AREA, MIN_PART_POINTS = 1.5, 6
#: Number of points whose plane is not known: they do not count.
UNKNOWN = -1


@dataclass(frozen=True, eq=False)
class PlaneScore:
    """Agreement of two divisions of points into planes, see `doc/scores.md`; a share of nothing is NaN."""

    n_points: int
    n_planes_result: int
    n_planes_reference: int
    n_planes_found: int
    precision: float
    recall: float
    f1: float
    weighted_coverage: float
    coverage: float
    #: That largest intersection over union of each of the reference's planes, by rising number, shape
    #: (n_planes_reference,).
    iou: NDArray[np.float64]


def score_planes(result: ArrayLike, reference: ArrayLike) -> PlaneScore:
    """
    Compare the planes of the same points; planes of the result without points that count are left out.

    0 = none, which counts: a plane of the result is the worse for points that the reference says are of none.
    Points whose reference is negative do not count. ValueError if the lengths differ.
    """
    theirs = np.asarray(reference)
    theirs = checked_column("reference", theirs, theirs.size, np.int64)
    mine = checked_column("result", result, len(theirs), np.int64)
    counted = theirs > UNKNOWN
    iou, sizes = _overlaps(mine[counted], theirs[counted])
    n_reference, n_result = iou.shape
    n_found = _n_pairs(iou)
    best = iou.max(axis=1, initial=0.0)
    return PlaneScore(
        n_points=int(counted.sum()),
        n_planes_result=n_result,
        n_planes_reference=n_reference,
        n_planes_found=n_found,
        precision=ratio(n_found, n_result),
        recall=ratio(n_found, n_reference),
        f1=ratio(2 * n_found, n_result + n_reference),
        weighted_coverage=float(best @ sizes / sizes.sum()) if n_reference else math.nan,
        coverage=float(best.mean()) if n_reference else math.nan,
        iou=best,
    )


def planes_of_colours(points: ArrayLike, colour: ArrayLike) -> NDArray[np.int64]:
    """
    Number the planes of points that somebody has coloured by hand: each connected part of a colour is one.

    From 1; −1 for points without colour, which is negative, and for those of parts too small to be meant.
    """
    cloud = checked_points(points)
    given = checked_column("colour", colour, len(cloud), np.int64)
    planes = np.full(len(cloud), UNKNOWN, dtype=np.int64)
    if not len(cloud):
        return planes
    spacing = measure_spacing(cloud)
    gap = max(PART_GAP, PART_GAP_SPACINGS * spacing)
    fewest = max(MIN_PART_POINTS, math.ceil(MIN_PART_AREA / spacing**2))
    n_planes = 0
    for one in np.unique(given[given >= 0]):
        rows = np.flatnonzero(given == one)
        part = connected_parts(cloud[rows], gap)
        large = np.flatnonzero(np.bincount(part) >= fewest)
        for number in large:
            n_planes += 1
            planes[rows[part == number]] = n_planes
    return planes


def _overlaps(
    mine: NDArray[np.int64], theirs: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the intersection over union of all pairs of planes, and the sizes of the reference's."""
    numbers, mine = np.unique(np.append(mine, 0), return_inverse=True)
    names, theirs = np.unique(np.append(theirs, 0), return_inverse=True)
    # The point of no plane on either side made sure that 0 comes first.
    shape = (len(names), len(numbers))
    common = np.bincount(
        theirs.reshape(-1)[:-1] * shape[1] + mine.reshape(-1)[:-1], minlength=shape[0] * shape[1]
    ).reshape(shape)
    either = common.sum(axis=1)[:, None] + common.sum(axis=0)[None, :] - common
    iou = common[1:, 1:] / np.maximum(either[1:, 1:], 1)
    return iou, common.sum(axis=1)[1:]


def _n_pairs(iou: NDArray[np.float64]) -> int:
    free_rows, free_columns = (np.ones(n, dtype=bool) for n in iou.shape)
    # More than one plane can only be the same as another if each is exactly half of it.
    for row, column in np.argwhere(iou >= MIN_IOU):
        if free_rows[row] and free_columns[column]:
            free_rows[row] = free_columns[column] = False
    return int(np.count_nonzero(~free_rows))
