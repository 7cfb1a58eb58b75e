"""The roofs of solids as one surface over the plan: which building covers a spot, and how high."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, Face, Solid

#: A building: one solid, or several parts.
Solids = Sequence[Solid]
#: A roof face so steep that it hides this much less than its area in plan is a wall [m/m].
_LEAST_UPRIGHT = 1e-3
#: Parts of footprints nearer than this are one [m]: the grid on which models are written.
_GRID = 1e-3


@dataclass(frozen=True, eq=False)
class RoofSurfaces:
    """All roof faces of some buildings."""

    polygons: NDArray[Any]  #: the faces in plan, shapely.Polygon [m]
    slopes: NDArray[np.float64]  #: rise of each face's plane along x and y [m/m], shape (n_faces, 2)
    origins: NDArray[np.float64]  #: a point of each plane [m], shape (n_faces, 3)
    building: NDArray[np.int64]  #: row of the building that each face belongs to, shape (n_faces,)

    def over(self, xy: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """
        Return the building (−1 = none) and the roof's elevation (NaN) at positions of shape (n, 2).

        Where several roofs lie over one another the highest counts.
        """
        spots = np.asarray(xy, dtype=np.float64)[:, :2]
        building = np.full(len(spots), -1, dtype=np.int64)
        elevation = np.full(len(spots), np.nan)
        points = shapely.points(spots)
        row, face = shapely.STRtree(self.polygons).query(points, predicate="intersects")
        offset = spots[row] - self.origins[face, :2]
        z = self.origins[face, 2] + (self.slopes[face] * offset).sum(axis=1)
        # The highest comes last and stays; of equal ones that of the first building.
        order = np.lexsort((-self.building[face], z))
        building[row[order]], elevation[row[order]] = self.building[face[order]], z[order]
        return building, elevation


def roof_surfaces(buildings: Sequence[Solids]) -> RoofSurfaces:
    """Collect the roof faces of buildings, of whose parts each has a solid."""
    polygons, slopes, origins, rows = [], [], [], []
    for row, parts in enumerate(buildings):
        for solid in parts:
            for face in faces_of(solid, ROOF_SURFACE):
                rings = solid.face_rings(face)
                slope = _slope_of(rings[0])
                if slope is not None:
                    polygons.append(_plan(rings))
                    slopes.append(slope)
                    origins.append(rings[0].mean(axis=0))
                    rows.append(row)
    return RoofSurfaces(
        np.array(polygons, dtype=object),
        np.array(slopes).reshape(-1, 2),
        np.array(origins).reshape(-1, 3),
        np.array(rows, dtype=np.int64),
    )


def footprints(buildings: Sequence[Solids]) -> NDArray[Any]:
    """Return what each building covers in plan: its ground faces, or its roof where it has none."""
    return np.array([_footprint(parts) for parts in buildings], dtype=object)


def faces_of(solid: Solid, kind: str) -> list[Face]:
    """Return a solid's faces of one kind: GroundSurface, RoofSurface or WallSurface."""
    return [face for face, word in zip(solid.faces, solid.semantics, strict=True) if word == kind]


def unit_normal(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit normal of a ring (Newell's sum), zeros if it has no area."""
    edges = ring - ring[0]
    normal: NDArray[np.float64] = np.cross(edges[1:-1], edges[2:]).sum(axis=0)
    length = np.linalg.norm(normal)
    return normal / length if length > 0 else np.zeros(3)


def _footprint(parts: Solids) -> shapely.Geometry:
    """Unite a building's ground faces, or its roof faces if there are none."""
    for kind in (GROUND_SURFACE, ROOF_SURFACE):
        faces = [_plan(solid.face_rings(face)) for solid in parts for face in faces_of(solid, kind)]
        if faces:
            return shapely.union_all(shapely.make_valid(np.array(faces, dtype=object)), grid_size=_GRID)
    return shapely.Polygon()


def _plan(rings: Sequence[NDArray[np.float64]]) -> shapely.Polygon:
    return shapely.Polygon(rings[0][:, :2], [ring[:, :2] for ring in rings[1:]])


def _slope_of(ring: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the rise of a ring's plane along x and y [m/m], None for an upright one."""
    normal = unit_normal(ring)
    if abs(normal[2]) < _LEAST_UPRIGHT:
        return None
    return float(-normal[0] / normal[2]), float(-normal[1] / normal[2])
