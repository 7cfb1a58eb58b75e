"""Large buildings in a raster of lowest elevations: told from hills by the step in which they end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

# Chosen with `bench.ground.scenes` and `bench.ground.isprs`.
#: A side of a cell across which the surface falls by more is a step [m].
STEP = 2.0
#: Share of its sides that have to be steps.
MIN_STEPS = 0.8
#: What sides on the raster's edge weigh in that share: they show no step, nor its absence.
UNSEEN_WEIGHT = 0.5
#: The four sides of a cell as (axis, shift), and the eight cells around one.
SIDES = ((0, 1), (0, -1), (1, 1), (1, -1))
AROUND = np.ones((3, 3), dtype=np.bool_)


def nearest_known(known: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return row and column of the known cell nearest to each cell of a raster."""
    row, column = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return row, column


def find_halls(
    surface: NDArray[np.float64],
    known: NDArray[np.bool_],
    raised: NDArray[np.bool_],
    nearest: tuple[NDArray[np.intp], NDArray[np.intp]],
) -> NDArray[np.bool_]:
    """
    Return the known cells of those raised regions that end in a step nearly all round.

    A wall is abrupt, a hillside is not (after Chen et al. 2007). A region's sides are looked at between
    neighbouring cells; cells without points count to the nearest one with.

    Parameters
    ----------
    surface, known : ndarray of shape (n_rows, n_columns)
        Lowest elevation of each cell [m], and which cells have points.
    raised : ndarray of shape (n_rows, n_columns), bool
        Known cells that a large disc does not reach from below, those of smaller objects among them: trees
        that stand against a wall hide its step, but end in one themselves.
    nearest : tuple of two ndarray of shape (n_rows, n_columns)
        What `nearest_known` says of `known`.
    """
    if not raised.any():
        return raised
    region, n_regions = ndimage.label(raised[nearest], structure=AROUND)
    return known & (_share_of_steps(surface[nearest], region, n_regions)[region] >= MIN_STEPS)


def _share_of_steps(
    surface: NDArray[np.float64], region: NDArray[np.int32], n_regions: int
) -> NDArray[np.float64]:
    """
    Return the share of each region's sides that are steps; 0 for what is in no region, which comes first.
    """
    surface = np.pad(surface, 1, constant_values=np.nan)
    region = np.pad(region, 1)
    steps, sides = np.zeros(n_regions + 1), np.zeros(n_regions + 1)
    for axis, shift in SIDES:
        at_rim = (region > 0) & (np.roll(region, shift, axis) == 0)
        fall = (surface - np.roll(surface, shift, axis))[at_rim]
        sides += np.bincount(region[at_rim], np.where(np.isnan(fall), UNSEEN_WEIGHT, 1.0), n_regions + 1)
        steps += np.bincount(region[at_rim], fall > STEP, n_regions + 1)
    return np.divide(steps, sides, out=np.zeros_like(steps), where=sides > 0.0)
