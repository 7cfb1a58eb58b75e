"""Polygons as scores see them: valid, cut to an area, simplified; their vertices."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

#: An object that the area of interest cuts and nothing answers counts if so much of it lies inside.
MIN_INSIDE = 0.5
#: A vertex so near to the line between its neighbours is on it: maps are drawn to about that [m].
STRAIGHT = 0.1


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


def within(places: NDArray[np.float64], limits: shapely.Geometry | None) -> NDArray[np.bool_]:
    """Tell which places, shape (n, 2) or (n, 3), lie in limits or on their edge; all where there are none."""
    if limits is None:
        return np.ones(len(places), dtype=bool)
    shapely.prepare(limits)
    return np.asarray(shapely.intersects_xy(limits, places[:, 0], places[:, 1]), dtype=bool)


def cut_to(
    polygons: NDArray[Any], limits: shapely.Geometry | None
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Cut polygons to the limits; return them with the share of their area that is left, 0 for empty ones."""
    whole = shapely.area(polygons)
    if limits is not None:
        polygons = valid_polygons(shapely.intersection(polygons, limits))
    return polygons, np.divide(shapely.area(polygons), whole, out=np.zeros(len(whole)), where=whole > 0)


def simplified(polygons: NDArray[Any], tolerance: float = STRAIGHT) -> NDArray[Any]:
    """
    Return valid polygons without vertices on straight walls, within a tolerance (Douglas & Peucker, 1973).
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


def spots_along(lines: NDArray[np.float64], step: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return spots along lines of shape (n, 2, dimensions), after the row of each spot's line [m]."""
    vectors = lines[:, 1] - lines[:, 0]
    counts = np.maximum(np.ceil(np.linalg.norm(vectors, axis=1) / step).astype(np.int64), 1)
    row = np.repeat(np.arange(len(lines)), counts)
    place = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    return row, lines[row, 0] + ((place + 0.5) / counts[row])[:, None] * vectors[row]
