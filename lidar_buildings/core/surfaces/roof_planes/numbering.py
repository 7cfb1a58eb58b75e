"""
Numbers of planes without gaps, and back: work grows with the planes that have points, not with their numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import IntArray
from lidar_buildings.core.surfaces.roof_planes.roof_plane import RoofPlane


def without_gaps(plane_id: NDArray[np.uint16]) -> tuple[NDArray[np.uint16], IntArray]:
    """
    Renumber planes from 1 in their order.

    Parameters
    ----------
    plane_id : ndarray of shape (n_points,)
        Number of each point's plane, 0 = none.

    Returns
    -------
    renumbered : ndarray of shape (n_points,), uint16
    number : ndarray of shape (n_planes + 1,), int64
        The number that each new number stands for; 0 for 0.
    """
    counts = np.bincount(plane_id, minlength=1)
    counts[0] = 1
    number = np.flatnonzero(counts)
    if number[-1] == len(number) - 1:
        return plane_id, number
    new = np.zeros(len(counts), dtype=np.uint16)
    new[number] = np.arange(len(number))
    return new[plane_id], number


def with_gaps(planes: tuple[RoofPlane, ...], number: IntArray) -> tuple[RoofPlane, ...]:
    """Return planes under their old numbers, with level planes without points in the gaps."""
    if number[-1] == len(planes):
        return planes
    nothing = RoofPlane(np.array([0.0, 0.0, 1.0]), planes[0].centroid, 0.0, 0)
    listed = [nothing] * int(number[-1])
    for plane, old in zip(planes, number[1:], strict=True):
        listed[old - 1] = plane
    return tuple(listed)
