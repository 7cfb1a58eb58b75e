"""
Large buildings in a raster of lowest elevations: told from hills by the step in which they end.

"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

#: A side of a cell across which the surface falls by more is a step [m].
STEP = 2.0
#: Share of its sides that have to be steps.
MIN_STEPS = 0.7
#: Weight of sides that say nothing, at the data's edge and towards other objects.
UNSEEN_WEIGHT = 0.5
#: The four sides of a cell, and eight cells around one.
SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0))
AROUND = np.ones((3, 3), dtype=np.bool_)


def find_halls(
    surface: NDArray[np.float64],
    known: NDArray[np.bool_],
    objects: NDArray[np.bool_],
    raised: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """
    Return the cells of those raised regions that end in a step nearly all round.

    A wall is abrupt, a hillside is not (Chen et al. 2007). A region's sides are looked at between
    neighbouring cells; cells without points count to the nearest one with.

    Parameters
    ----------
    surface : ndarray of shape (n_rows, n_columns)
        Lowest elevation of each known cell [m].
    known : ndarray of shape (n_rows, n_columns), bool
        Cells with points.
    objects : ndarray of shape (n_rows, n_columns), bool
        Smaller objects found before.
    raised : ndarray of shape (n_rows, n_columns), bool
        Known cells that a large disc does not reach from below.

    """
    raised = raised & ~objects
    if not raised.any():
        return raised
    nearest = tuple(ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True))
    region, n_regions = ndimage.label(raised[nearest], structure=AROUND)
    share = _share_of_steps(surface[nearest], objects[nearest], region, n_regions)
    return known & (share[region] >= MIN_STEPS)


def _share_of_steps(
    surface: NDArray[np.float64], objects: NDArray[np.bool_], region: NDArray[np.int32], n_regions: int
) -> NDArray[np.float64]:
    """
    Return the share of each region's sides that are steps; 0 for what is in no region, which comes first.

    """
    surface, region = np.pad(surface, 1), np.pad(region, 1)
    objects = np.pad(objects, 1, constant_values=True)
    steps, sides = np.zeros(n_regions + 1), np.zeros(n_regions + 1)
    for side in SIDES:
        there = (
            slice(1 + side[0], surface.shape[0] - 1 + side[0]),
            slice(1 + side[1], surface.shape[1] - 1 + side[1]),
        )
        here = slice(1, -1), slice(1, -1)
        at_rim = (region[here] > 0) & (region[there] == 0)
        of = region[here][at_rim]
        seen = ~objects[there][at_rim]
        fall = (surface[here] - surface[there])[at_rim]
        sides += np.bincount(of, np.where(seen, 1.0, UNSEEN_WEIGHT), n_regions + 1)
        steps += np.bincount(of, seen & (fall > STEP), n_regions + 1)
    return np.divide(steps, sides, out=np.zeros_like(steps), where=sides > 0.0)
