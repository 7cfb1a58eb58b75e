"""How roofs are cut out of planes: the lowest or the highest of several at every position."""

from __future__ import annotations

import numpy as np
import shapely

from lidar_buildings.simulation.building import GRID, RoofFace, face_over

#: Larger than any building [m].
FAR = 1e4
#: Two faces whose slopes differ by less are parallel [m/m]; one plane if their elevations do not either [m].
SAME_SLOPE = 1e-9


def slope_of(pitch_deg: float) -> float:
    """Rise over run."""
    return float(np.tan(np.deg2rad(pitch_deg)))


def box(length: float, width: float) -> shapely.Polygon:
    """Rectangle centred on the origin."""
    return shapely.box(-length / 2, -width / 2, length / 2, width / 2)


def rim_planes(length: float, width: float, eave: float, slope: float) -> list[tuple[float, float, float]]:
    """Return planes that rise inwards from the four sides of a centred rectangle (outwards if negative)."""
    along, across = eave + slope * length / 2, eave + slope * width / 2
    return [(0.0, slope, across), (-slope, 0.0, along), (0.0, -slope, across), (slope, 0.0, along)]


def gable_faces(
    polygon: shapely.Polygon, half_width: float, eave: float, slope: float
) -> tuple[RoofFace, ...]:
    """Southern and northern face of a roof whose ridge is the x axis."""
    top = eave + slope * half_width
    return lowest(polygon, [(0.0, slope, top), (0.0, -slope, top)])


def lowest(
    polygon: shapely.Polygon, planes: list[tuple[float, float, float]], highest: bool = False
) -> tuple[RoofFace, ...]:
    """Cut a polygon into the pieces over which each plane is the lowest (or the highest) of all."""
    faces = []
    for plane in planes:
        piece = polygon
        for other in planes:
            if other is not plane:
                low, high = (other, plane) if highest else (plane, other)
                piece = shapely.intersection(piece, _where_higher(high, low), grid_size=GRID)
        faces.extend(face_over(part, plane) for part in _polygons(piece))
    return tuple(faces)


def highest_of(first: tuple[RoofFace, ...], second: tuple[RoofFace, ...]) -> tuple[RoofFace, ...]:
    """Join two roofs: where both cover a position the higher one stays."""
    return (*_not_under(first, second), *_not_under(second, first))


def joined(faces: tuple[RoofFace, ...]) -> tuple[RoofFace, ...]:
    """Join the faces that lie on one plane and overlap or touch."""
    kept: list[RoofFace] = []
    for face in faces:
        same = [other for other in kept if _same_plane(face, other)]
        union = shapely.union_all([f.polygon for f in (face, *same)], grid_size=GRID)
        kept = [other for other in kept if other not in same]
        kept.extend(face_over(part, face.plane) for part in _polygons(union))
    return tuple(kept)


def _same_plane(one: RoofFace, other: RoofFace) -> bool:
    return bool(np.allclose(one.plane, other.plane, rtol=0.0, atol=SAME_SLOPE))


def _not_under(faces: tuple[RoofFace, ...], others: tuple[RoofFace, ...]) -> list[RoofFace]:
    """The parts of faces over which no other face is higher."""
    kept = []
    for face in faces:
        piece = face.polygon
        for other in others:
            if _same_plane(face, other):
                continue
            above = shapely.intersection(
                other.polygon, _where_higher(other.plane, face.plane), grid_size=GRID
            )
            piece = shapely.difference(piece, above, grid_size=GRID)
        kept.extend(face_over(part, face.plane) for part in _polygons(piece))
    return kept


def _where_higher(plane: tuple[float, float, float], other: tuple[float, float, float]) -> shapely.Polygon:
    """Half-plane over which `plane` is at least as high as `other`, as a large rectangle."""
    a, b, c = np.subtract(plane, other)
    steepness = np.hypot(a, b)
    if steepness < SAME_SLOPE:
        return shapely.box(-FAR, -FAR, FAR, FAR) if c >= 0 else shapely.Polygon()
    uphill = np.array([a, b]) / steepness
    along = np.array([-uphill[1], uphill[0]])
    foot = -c / steepness * uphill
    near, far = foot - FAR * along, foot + FAR * along
    return shapely.Polygon([near, far, far + FAR * uphill, near + FAR * uphill])


def _polygons(geometry: shapely.Geometry) -> list[shapely.Polygon]:
    """The polygons of a geometry; lines, points and slivers of the cutting are left out."""
    parts = shapely.get_parts(shapely.get_parts(geometry))
    return [part for part in parts if isinstance(part, shapely.Polygon) and part.area > 1e-2]
