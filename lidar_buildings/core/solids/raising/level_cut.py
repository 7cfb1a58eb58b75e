"""Faces of a roof cut where their plane has an elevation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.solids.output_grid import polygons_of

_Rings = tuple[FloatArray, ...]


def cut_at(
    rings: _Rings, plane: Sequence[float] | FloatArray, elevation: float
) -> tuple[list[_Rings], list[_Rings]]:
    """
    Return the rings, open, of the parts of a face above an elevation [m], and of the others.

    The face's exterior and holes may be unsound; its plane, z = a·x + b·y + c, is not level.
    """
    polygon = shapely.make_valid(
        shapely.Polygon(rings[0], rings[1:]), method="structure", keep_collapsed=False
    )
    upper = polygon.intersection(_half_plane(rings[0], np.asarray(plane), elevation))
    return _rings(upper), _rings(polygon.difference(upper))


def _half_plane(ring: FloatArray, plane: FloatArray, elevation: float) -> shapely.Polygon:
    """Return a rectangle over what of a ring lies above an elevation; it ends where the plane has that."""
    steepness = float(np.hypot(*plane[:2]))
    uphill = plane[:2] / steepness
    centre = ring.mean(axis=0)
    a, b, c = plane.tolist()
    x, y = centre.tolist()
    start = centre + (elevation - (a * x + b * y + c)) / steepness * uphill
    size = 4.0 * float(np.ptp(ring, axis=0).sum() + np.abs(start - centre).sum())
    across = size * np.array([-uphill[1], uphill[0]])
    return shapely.Polygon(
        [start - across, start + across, start + across + size * uphill, start - across + size * uphill]
    )


def _rings(geometry: shapely.Geometry) -> list[_Rings]:
    """Return the rings of all polygons of a geometry, open."""
    return [
        tuple(shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors))
        for polygon in polygons_of(geometry)
    ]
