"""Roof faces that rise above everything that was seen, cut off level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.solids.output_grid import GRID, polygons_of
from lidar_buildings.core.stages.building_model.cell_costs import ABOVE
from lidar_buildings.core.stages.building_model.roof_face import RoofFacePatch


def with_level_tops(faces: list[RoofFacePatch], points: FloatArray, spacing: float) -> list[RoofFacePatch]:
    """
    Cut off what rises above all points, as where a whole slope of a roof has none.

    A plane is good where its points are. Beyond them the roof is level, at the height of the highest return.

    Parameters
    ----------
    faces : list of RoofFacePatch
    points : ndarray of shape (n_points, 3)
        The building's points [m].
    spacing : float
        Point spacing: roofs run on for so much beyond their points [m].
    """
    planes, exteriors = np.array([face.plane for face in faces]), [face.rings[0] for face in faces]
    sizes = np.array([len(ring) for ring in exteriors])
    xy, own = np.concatenate(exteriors), np.repeat(planes, sizes, axis=0)
    highest = np.maximum.reduceat(np.einsum("ij,ij->i", own[:, :2], xy) + own[:, 2], np.cumsum(sizes) - sizes)
    tops = points[:, 2].max() + ABOVE + spacing * np.hypot(planes[:, 0], planes[:, 1])
    return [
        piece
        for face, high, top in zip(faces, highest.tolist(), tops.tolist(), strict=True)
        for piece in ([face] if high <= top else _cut_off(face, top))
    ]


def _cut_off(face: RoofFacePatch, top: float) -> list[RoofFacePatch]:
    """Return the pieces of a face below an elevation, which keep its points, and level ones."""
    whole, corners = shapely.Polygon(face.rings[0], face.rings[1:]), face.rings[0]
    rise = float(np.hypot(*face.plane[:2]))
    uphill = face.plane[:2] / rise
    along = np.array([-uphill[1], uphill[0]])
    at = corners @ uphill, corners @ along
    foot = (top - face.plane[2]) / rise
    ends = (foot, at[1].min() - 1.0), (at[0].max() + 1.0, at[1].max() + 1.0)
    strip = shapely.box(*ends[0], *ends[1])
    strip = shapely.transform(strip, lambda place: place @ np.stack([uphill, along]))
    below = polygons_of(shapely.difference(whole, strip, grid_size=GRID))
    above = polygons_of(shapely.intersection(whole, strip, grid_size=GRID))
    level, none = np.array([0.0, 0.0, top]), face.rows[:0]
    pieces = [replace(face, rings=_rings(part), rows=none) for part in below]
    if pieces:
        pieces[0] = replace(pieces[0], rows=face.rows)
    return pieces + [replace(face, rings=_rings(part), plane=level, rows=none) for part in above]


def _rings(polygon: shapely.Polygon) -> tuple[FloatArray, ...]:
    """Return a polygon's rings, the outer one counter-clockwise, its holes clockwise, open."""
    oriented = shapely.geometry.polygon.orient(polygon)
    return tuple(np.asarray(ring.coords)[:-1] for ring in (oriented.exterior, *oriented.interiors))
