"""Vertices of simplified outlines: maps are densified, cuts and unions leave vertices on straight walls."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

#: A vertex so near to the line between its neighbours is on it: maps are drawn to about that [m].
STRAIGHT = 0.1


def simplified(polygons: NDArray[Any], tolerance: float = STRAIGHT) -> NDArray[Any]:
    """
    Return valid polygons without vertices on straight walls (Douglas & Peucker, 1973).

    Parameters
    ----------
    polygons : ndarray of shapely geometries
        Valid polygons [m].
    tolerance : float
        How far what is left out may lie from the new walls [m].
    """
    return np.asarray(shapely.simplify(polygons, tolerance, preserve_topology=True), dtype=object)


def vertex_counts(polygons: NDArray[Any]) -> NDArray[np.int64]:
    """Count each outline's vertices, without the repeated one that closes a ring."""
    owner = shapely.get_rings(polygons, return_index=True)[1]
    counts = shapely.get_num_coordinates(polygons) - np.bincount(owner, minlength=len(polygons))
    return np.asarray(counts, dtype=np.int64)


def open_rings(polygons: NDArray[Any]) -> list[NDArray[np.float64]]:
    """Return the coordinates of all rings, without the repeated vertex that closes them."""
    return [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(polygons)]
