"""
Planar subdivisions: the faces into which rings divide the plane, and the polygon that each face belongs to.

Outlines of a block that share walls are divided here. Vertices lie on a grid, so that equal places are equal
numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.array_types import IntArray

#: Stands for what lies in no polygon.
OUTSIDE = -1

#: Of pairs of a face and a polygon, and the faces' inner points: keys by which the least pair is preferred.
Preference = Callable[[IntArray, IntArray, NDArray[np.object_]], Sequence[NDArray[Any]]]


def divide_plane(rings: NDArray[np.object_], grid: float) -> NDArray[np.object_]:
    """
    Return the faces into which rings divide the plane, their vertices on multiples of `grid`.

    Rings are noded by snap rounding (Hobby, 1999): edges nearer to a vertex than half a step run through it.
    """
    noded = shapely.union_all(rings, grid_size=grid)
    return np.asarray(shapely.get_parts(shapely.polygonize(shapely.get_parts(noded))))


def face_owners(
    faces: NDArray[np.object_], polygons: NDArray[np.object_], prefer: Preference | None = None
) -> IntArray:
    """Return which polygon each face lies in, of several the first, or the preferred one, else OUTSIDE."""
    inside = shapely.point_on_surface(faces)
    face, polygon = shapely.STRtree(polygons).query(inside, predicate="intersects")
    keys = () if prefer is None else prefer(face, polygon, inside)
    order = np.lexsort((polygon, *reversed(keys), face))
    face, polygon = face[order], polygon[order]
    first = np.flatnonzero(np.diff(face, prepend=-1))
    owners = np.full(len(faces), OUTSIDE)
    owners[face[first]] = polygon[first]
    return owners
