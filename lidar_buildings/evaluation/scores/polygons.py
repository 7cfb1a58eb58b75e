"""Polygons made ready for comparison: repaired, and cut to the area of interest."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

#: An object that the area of interest cuts and nothing answers counts if so much of it lies inside.
MIN_INSIDE = 0.5


def valid_polygons(polygons: ArrayLike) -> NDArray[Any]:
    """Return the geometries as an array, repaired, with None and what has no area as an empty polygon."""
    given = np.atleast_1d(np.asarray(polygons, dtype=object))
    valid = shapely.make_valid(shapely.force_2d(given))
    # A repair can leave dangling lines beside the polygons: a zero-width buffer keeps the areas alone.
    valid = np.where(shapely.get_dimensions(valid) == 2, shapely.buffer(valid, 0.0), shapely.Polygon())
    return np.asarray(valid, dtype=object)


def limits_of(area: ArrayLike | None) -> shapely.Geometry | None:
    """Return the union of an area of interest's polygons, None if there is no such area."""
    return None if area is None else shapely.union_all(valid_polygons(area))


def cut_to(
    polygons: NDArray[Any], limits: shapely.Geometry | None
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Cut polygons to the limits; return them with the share of their area that is left, 0 for empty ones."""
    whole = shapely.area(polygons)
    if limits is not None:
        polygons = valid_polygons(shapely.intersection(polygons, limits))
    return polygons, np.divide(shapely.area(polygons), whole, out=np.zeros(len(whole)), where=whole > 0)
