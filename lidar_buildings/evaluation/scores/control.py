"""Terrain, walls and roofs of a result against a denser, sharper cloud, such as terrestrial scans."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from lidar_buildings.core.solids.shell import WALL_SURFACE, Solid
from lidar_buildings.core.surfaces.alignment import planes_at, thinned
from lidar_buildings.evaluation.scores.cells import Figures, named, percentile, ratio, root_mean_square
from lidar_buildings.evaluation.scores.models import Solids, faces_of, roof_elevations, unit_normal

_Floats = NDArray[np.float64]

#: Side of the cells of terrain, walls and roofs of which each counts once, however dense the cloud is [m].
CELL = 0.5
#: Walls are compared with what lies no further from them [m], and is parallel to them but for so much [deg].
REACH, _PARALLEL_DEG = 1.0, 20.0
#: Vertical part of the normals of walls at most, and of roofs at least.
_UPRIGHT, _ROOF = 0.2, 0.3


class Wall(NamedTuple):
    """An upright face of a model."""

    start: _Floats  #: where its foot begins in plan [m], shape (2,)
    along: _Floats  #: unit vector of the foot, shape (2,)
    outward: _Floats  #: unit normal, shape (2,)
    length: float  #: [m]
    low: float  #: elevations of its foot and top [m]
    high: float


def difference_figures(differences: _Floats) -> Figures:
    """Return number, median, median without sign, RMS and 90 % of differences [m]."""
    return {
        "n_cells": len(differences),
        "bias": percentile(differences, 50),
        "median": percentile(np.abs(differences), 50),
        "rmse": root_mean_square(differences),
        "percentile_90": percentile(np.abs(differences), 90),
    }


def terrain_differences(dtm: _Floats, places: _Floats, elevations: _Floats) -> _Floats:
    """
    Return the median of the DTM's elevation less that of points, of each cell that holds some [m].

    `places` are rows and columns of the points in the raster, counted from its first cell's middle, shape
    (n, 2); NaN is where the raster is unknown.
    """
    off = map_coordinates(dtm, places.T, order=1, mode="constant", cval=np.nan) - elevations
    known = np.isfinite(off)
    return _medians(np.rint(places[known]).astype(np.int64), off[known])


def score_control(buildings: Sequence[Solids], points: _Floats) -> Figures:
    """
    Compare walls and roofs of models with points that are no ground, shape (n, 3) [m].

    Points about which others lie on a plane count: on upright ones for the wall that is parallel and nearest,
    within `REACH`; on others for the roof over or under them. A difference is what the result lies outside,
    or above, the cloud. `wall_seen` is the share of the walls' length beside which there is a point.
    """
    of_walls, of_roofs, seen, total = [np.empty(0)], [np.empty(0)], 0.0, 0.0
    tree = shapely.STRtree(shapely.points(points[:, :2]))
    for parts in buildings:
        corners = np.concatenate([np.empty((0, 3)), *(part.vertices for part in parts)])
        if not len(corners):
            continue
        (west, south), (east, north) = corners[:, :2].min(axis=0) - REACH, corners[:, :2].max(axis=0) + REACH
        near = points[np.sort(tree.query(shapely.box(west, south, east, north)))]
        walls = list(walls_of(parts))
        total += sum(wall.length for wall in walls)
        if len(near) < 3:
            continue
        places, normals = planes_at(thinned(near))
        steepness = np.abs(normals[:, 2])
        upright = steepness <= _UPRIGHT
        differences, length = wall_differences(walls, places[upright], normals[upright])
        of_walls.append(differences)
        seen += length
        level = places[steepness >= _ROOF]
        off = roof_elevations(parts, level) - level[:, 2]
        known = np.isfinite(off)
        of_roofs.append(_medians(np.floor(level[known, :2] / CELL).astype(np.int64), off[known]))
    return {
        **named("wall", difference_figures(np.concatenate(of_walls))),
        "wall_seen": ratio(seen, total),
        **named("roof", difference_figures(np.concatenate(of_roofs))),
    }


def walls_of(parts: Sequence[Solid]) -> Iterator[Wall]:
    """Yield the walls of a building that are as long as a cell."""
    for solid in parts:
        for face in faces_of(solid, WALL_SURFACE):
            ring = solid.face_rings(face)[0]
            normal = unit_normal(ring)[:2]
            size = np.hypot(*normal)
            if size == 0.0:
                continue
            outward = normal / size
            along = np.array([-outward[1], outward[0]])
            at = ring[:, :2] @ along
            if np.ptp(at) >= CELL:
                start = ring[np.argmin(at), :2]
                yield Wall(start, along, outward, float(np.ptp(at)), *(ring[:, 2].min(), ring[:, 2].max()))


def wall_differences(walls: Sequence[Wall], places: _Floats, normals: _Floats) -> tuple[_Floats, float]:
    """Return how far walls lie outside points, cell by cell, and what length of them has one [m]."""
    if not walls or not len(places):
        return np.empty(0), 0.0
    nearest, out = np.full(len(places), -1), np.full(len(places), np.inf)
    cells = np.zeros((len(places), 3), dtype=np.int64)
    horizontal = normals[:, :2] / np.linalg.norm(normals[:, :2], axis=1, keepdims=True)
    for number, wall in enumerate(walls):
        away = places[:, :2] - wall.start
        at, off = away @ wall.along, -(away @ wall.outward)
        fits = (np.abs(off) <= REACH) & (np.abs(off) < np.abs(out)) & (at >= 0.0) & (at <= wall.length)
        fits &= (places[:, 2] >= wall.low) & (places[:, 2] <= wall.high)
        fits &= np.abs(horizontal @ wall.outward) >= np.cos(np.radians(_PARALLEL_DEG))
        nearest[fits], out[fits] = number, off[fits]
        cells[fits] = np.column_stack(
            [np.full(fits.sum(), number), np.floor(np.column_stack([at, places[:, 2]])[fits] / CELL)]
        )
    found = nearest >= 0
    spots = np.unique(cells[found, :2], axis=0)
    lengths = np.array([wall.length for wall in walls])[spots[:, 0]]
    seen = np.minimum(lengths - spots[:, 1] * CELL, CELL).sum()
    return _medians(cells[found], out[found]), float(seen)


def _medians(cells: NDArray[np.int64], values: _Floats) -> _Floats:
    """Return the median of the values of each cell."""
    if not len(values):
        return values
    number = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
    order = np.lexsort((values, number))
    first = np.flatnonzero(np.diff(number[order], prepend=-1))
    size = np.diff(np.append(first, len(order)))
    ranked = values[order]
    return np.asarray((ranked[first + (size - 1) // 2] + ranked[first + size // 2]) / 2.0)
