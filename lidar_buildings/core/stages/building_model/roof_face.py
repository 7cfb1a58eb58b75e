"""A face of a roof before it becomes part of a solid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from lidar_buildings.core.model.array_types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class RoofFacePatch:
    """
    A roof face: a polygon in plan with one plane, and its points.

    Attributes
    ----------
    rings : tuple of ndarray of shape (n_vertices, 2)
        Outer ring counter-clockwise, then holes clockwise, open [m].
    plane : ndarray of shape (3,)
        z = a·x + b·y + c.
    rows : ndarray of shape (n_points,), int64
        Rows of the building's points over the face.
    """

    rings: tuple[FloatArray, ...]
    plane: FloatArray
    rows: IntArray

    @property
    def polygon(self) -> shapely.Polygon:
        """The face in plan."""
        return shapely.Polygon(self.rings[0], self.rings[1:])


def open_rings(polygon: shapely.Polygon) -> tuple[FloatArray, ...]:
    """Return a polygon's rings, the outer one counter-clockwise, its holes clockwise, open."""
    oriented = shapely.geometry.polygon.orient(polygon)
    return tuple(np.asarray(ring.coords)[:-1] for ring in (oriented.exterior, *oriented.interiors))
