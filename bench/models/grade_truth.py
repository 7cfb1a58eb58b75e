"""What is true of a roof in plan, and how much of a model is off it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.generalise.corners import DrawnRoof
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid, face_plane
from lidar_buildings.simulation.building import Building, RoofFace

#: Side of the cells in which model and truth are compared [m].
CELL = 0.25
#: A model is off where it is so far from the truth [m], and off altogether on more than this share of both.
OFF_DISTANCE, OFF_SHARE = 0.5, 0.05
#: A drawn face whose plane fewer of the points over it lie on, within this [m], says nothing.
_MIN_ON_FACE, _ON_FACE = 0.5, 0.15
#: Smallest drawn face that is judged [m²]; corners nearer than this in plan stand over one another [m].
_MIN_FACE, _SAME_PLACE = 0.5, 0.05
_MOST_TRIPLES = 400
#: Walls are drawn to about a point spacing; what was seen farther beyond them was not drawn [m].
_BEYOND_WALLS = 0.25


class RoofTruth(NamedTuple):
    """A roof as faces over its plan."""

    faces: tuple[RoofFace, ...]
    plan: shapely.Geometry  #: all that is building, faces that are not known included

    def at(self, xy: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return elevations, NaN where not known or beside the roof, and which places are building."""
        elevation = np.full(len(xy), np.nan)
        for face in self.faces:
            inside = shapely.contains_xy(face.polygon, *xy.T)
            elevation[inside] = face.elevation(xy[inside])
        return elevation, shapely.contains_xy(self.plan, *xy.T)


def truth_of(building: Building) -> RoofTruth:
    """Return what is true of a virtual building."""
    return RoofTruth(building.faces, building.polygon)


def drawn_truth(roof: DrawnRoof) -> RoofTruth:
    """
    Return what a person drew: faces between the lines in plan, each with the plane of its corners.

    Where corners stand over one another those are taken that the points over the face agree with; a face
    without such is building of unknown height.
    """
    corners = roof.drawn.corners
    lines = shapely.node(shapely.multilinestrings(shapely.linestrings(corners[roof.drawn.edges][:, :, :2])))
    faces, polygons = [], shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
    for polygon in polygons:
        if polygon.area >= _MIN_FACE and (plane := _drawn_plane(polygon, corners, roof.points)) is not None:
            outer, *holes = (shapely.get_coordinates(r)[:-1] for r in (polygon.exterior, *polygon.interiors))
            faces.append(RoofFace((outer, *holes), plane))
    return RoofTruth(tuple(faces), shapely.union_all(polygons))


def largest_part(truth: RoofTruth, points: NDArray[np.float64]) -> tuple[RoofTruth, NDArray[np.float64]]:
    """
    Return the largest of several buildings, and the points that are nearest to it.

    What was seen beyond all walls that were drawn is no part of it: annexes and neighbours that nobody drew.
    """
    parts = sorted(shapely.get_parts(truth.plan), key=lambda one: -one.area)
    away = shapely.distance(np.array(parts)[:, None], shapely.points(points[:, :2]))
    faces = tuple(face for face in truth.faces if parts[0].contains(face.polygon.representative_point()))
    return RoofTruth(faces, parts[0]), points[(np.argmin(away, axis=0) == 0) & (away[0] < _BEYOND_WALLS)]


def _drawn_plane(
    polygon: shapely.Polygon, corners: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[float, float, float] | None:
    ring = shapely.points(shapely.get_coordinates(polygon))
    near = shapely.distance(shapely.points(corners[:, :2])[:, None], ring[None]).min(axis=1) < _SAME_PLACE
    known, over = corners[near], points[shapely.contains_xy(polygon, *points[:, :2].T)]
    triples = list(combinations(range(len(known)), 3))
    best, plane = 0.0, None
    for rows in triples[:: max(1, len(triples) // _MOST_TRIPLES)]:
        matrix = np.column_stack([known[list(rows), :2], np.ones(3)])
        if abs(np.linalg.det(matrix)) < 0.2 * polygon.area or not len(over):
            continue
        a, b, c = np.linalg.solve(matrix, known[list(rows), 2])
        share = np.mean(np.abs(over[:, :2] @ (a, b) + c - over[:, 2]) < _ON_FACE * math.hypot(1.0, a, b))
        if share > best:
            best, plane = float(share), (float(a), float(b), float(c))
    return plane if best >= _MIN_ON_FACE else None


def model_at(
    solids: Sequence[Solid], xy: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the elevations of solids' roofs, the highest of several, and where there is one."""
    elevation = np.full(len(xy), -np.inf)
    for solid in solids:
        for face, kind in zip(solid.faces, solid.semantics, strict=True):
            rings = solid.face_rings(face)
            if kind != ROOF_SURFACE or (plane := face_plane(rings)) is None:
                continue
            inside = shapely.contains_xy(
                shapely.Polygon(rings[0][:, :2], [r[:, :2] for r in rings[1:]]), *xy.T
            )
            a, b, c = plane
            elevation[inside] = np.maximum(elevation[inside], xy[inside] @ (a, b) + c)
    return elevation, np.isfinite(elevation)


class Difference(NamedTuple):
    """On which shares of the union of both plans model and truth differ."""

    truth_alone: float
    model_alone: float
    height: float  #: both are there, more than `OFF_DISTANCE` apart

    @property
    def total(self) -> float:
        """The sum of all."""
        return self.truth_alone + self.model_alone + self.height

    @property
    def is_off(self) -> bool:
        """Whether the model is off."""
        return self.total > OFF_SHARE


def difference(solids: Sequence[Solid], truth: RoofTruth) -> Difference:
    """Compare models with the truth in cells; where no height is known only the plans count."""
    bounds = [truth.plan.bounds]
    bounds += [(*one.vertices[:, :2].min(axis=0), *one.vertices[:, :2].max(axis=0)) for one in solids]
    low, high = np.min(bounds, axis=0)[:2], np.max(bounds, axis=0)[2:]
    x, y = (np.arange(a, b, CELL) + CELL / 2 for a, b in zip(low, high, strict=True))
    xy = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    (real, is_building), (found, is_model) = truth.at(xy), model_at(solids, xy)
    with np.errstate(invalid="ignore"):
        is_off = is_building & is_model & (np.abs(found - real) > OFF_DISTANCE)
    parts = (is_building & ~is_model, is_model & ~is_building, is_off)
    n = max(int(np.count_nonzero(is_building | is_model)), 1)
    return Difference(*(int(np.count_nonzero(part)) / n for part in parts))
