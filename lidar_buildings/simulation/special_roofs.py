"""
Roof shapes beyond the plain ones: broken slopes, crossing ridges, halls, churches.

Each function returns a building centred on the origin, length along x, foot at z = 0.
"""

from __future__ import annotations

import numpy as np
import shapely

from lidar_buildings.simulation.building import GRID, Building, RoofFace, building_of, face_over
from lidar_buildings.simulation.roof_cutting import (
    box,
    gable_faces,
    highest_of,
    joined,
    lowest,
    rim_planes,
    slope_of,
)


def half_hip() -> Building:
    """Return a gable house whose gables end in small hips, which begin half-way up the roof."""
    length, width, eave = 15.0, 10.0, 5.0
    slope = slope_of(40.0)
    top = eave + slope * width / 2
    end = eave + 0.5 * slope * width / 2 + slope * length / 2
    planes = [(0.0, slope, top), (0.0, -slope, top), (slope, 0.0, end), (-slope, 0.0, end)]
    return building_of("half_hip", lowest(box(length, width), planes))


def pyramid() -> Building:
    """Return a square building whose four faces meet in one point."""
    side = 10.0
    return building_of("pyramid", lowest(box(side, side), rim_planes(side, side, 5.0, slope_of(35.0))))


def gambrel(lower_pitch_deg: float = 60.0, break_width: float = 1.8) -> Building:
    """Return a gable house whose faces are steep near the eaves, over this width, and flatter above."""
    width, eave = 10.0, 4.0
    steep, slope = slope_of(lower_pitch_deg), slope_of(25.0)
    low = eave + steep * width / 2
    high = eave + steep * break_width + slope * (width / 2 - break_width)
    planes = [(0.0, steep, low), (0.0, slope, high), (0.0, -slope, high), (0.0, -steep, low)]
    return building_of("gambrel", lowest(box(14.0, width), planes))


def mansard() -> Building:
    """Return a building with steep faces on all four sides, 1.8 m wide in plan, and a flat top."""
    length, width, eave = 16.0, 12.0, 7.0
    slope = slope_of(60.0)
    planes = [*rim_planes(length, width, eave, slope), (0.0, 0.0, eave + slope * 1.8)]
    return building_of("mansard", lowest(box(length, width), planes))


def cross_gable() -> Building:
    """Return two gable roofs of one size that cross in the middle, their ridges at one height."""
    length, width, eave, pitch_deg = 18.0, 8.0, 5.0, 35.0
    top, slope = eave + slope_of(pitch_deg) * width / 2, slope_of(pitch_deg)
    along = gable_faces(box(length, width), width / 2, eave, slope)
    across = lowest(box(width, length), [(slope, 0.0, top), (-slope, 0.0, top)])
    return building_of("cross_gable", highest_of(along, across))


def hipped_l() -> Building:
    """Return a hip roof over two wings of one width that make a corner in the south-west."""
    length, width, depth, eave = 18.0, 8.0, 16.0, 5.0
    slope = slope_of(35.0)
    wing = box(width, depth)
    first = lowest(box(length, width), rim_planes(length, width, eave, slope))
    second = lowest(wing, rim_planes(width, depth, eave, slope))
    shift = (width - length) / 2, (depth - width) / 2
    moved = tuple(_moved(face, *shift) for face in second)
    return building_of("hipped_l", joined(highest_of(first, moved)))


def double_gable() -> Building:
    """Return two gable roofs side by side with a valley between: an M."""
    width = 16.0
    slope, quarter = slope_of(35.0), width / 4
    faces: list[RoofFace] = []
    for y in (-quarter, quarter):
        half = gable_faces(box(14.0, width / 2), quarter, 5.0, slope)
        faces += [_moved(face, 0.0, y) for face in half]
    return building_of("double_gable", tuple(faces))


def gable_dormer() -> Building:
    """Return a gable house with a gabled dormer to the south, its eave above that of the house."""
    width, eave, dormer_width, dormer_eave = 11.0, 5.0, 4.0, 1.8
    slope = slope_of(40.0)
    rise = slope_of(30.0) * dormer_width / 2
    # Eave and ridge of the dormer meet the face on the grid, so that neighbours share these corners.
    run = np.round(np.array([dormer_eave, dormer_eave + rise]) / slope / GRID) * GRID
    top = eave + float(run[1]) * slope
    pitch = float(run[1] - run[0]) * slope / (dormer_width / 2)
    cut = shapely.box(-dormer_width / 2, -width / 2 + 0.8, dormer_width / 2, 0.0)
    over = lowest(cut, [(pitch, 0.0, top), (-pitch, 0.0, top)])
    house = gable_faces(box(16.0, width), width / 2, eave, slope)
    return building_of("gable_dormer", highest_of(house, over))


def sawtooth() -> Building:
    """Return a hall of sheds in a row, each rising to the east and ending in an upright window."""
    length, width, n_teeth = 24.0, 14.0, 4
    slope, tooth = slope_of(20.0), length / n_teeth
    west = -length / 2 + tooth * np.arange(n_teeth)
    faces = (
        face_over(shapely.box(x, -width / 2, x + tooth, width / 2), (slope, 0.0, 5.0 - slope * x))
        for x in west.tolist()
    )
    return building_of("sawtooth", tuple(faces))


def barrel() -> Building:
    """Return a hall under an arc, 4 m high in the middle, as facets of equal angle."""
    length, width, rise, n_facets = 26.0, 16.0, 4.0, 12
    radius = (width**2 / 4 + rise**2) / (2 * rise)
    reach = np.arcsin(width / 2 / radius)
    angle = np.linspace(-reach, reach, n_facets + 1)
    y = np.round(radius * np.sin(angle) / GRID) * GRID
    z = 5.0 + radius * (np.cos(angle) - np.cos(reach))
    slope = np.diff(z) / np.diff(y)
    faces = (
        face_over(
            shapely.box(-length / 2, y[k], length / 2, y[k + 1]), (0.0, slope[k], z[k] - slope[k] * y[k])
        )
        for k in range(n_facets)
    )
    return building_of("barrel", tuple(faces))


def church() -> Building:
    """Return a steep gable nave with a square tower at its western end and a spire on it."""
    length, width, tower = 22.0, 11.0, 6.0
    nave = gable_faces(box(length, width), width / 2, 8.0, slope_of(50.0))
    slope = 14.0 / (tower / 2)
    top = lowest(box(tower, tower), rim_planes(tower, tower, 20.0, slope))
    west = -(length + tower) / 2
    return building_of("church", (*nave, *(_moved(face, west, 0.0) for face in top)))


def parapet(rim: float = 0.5, rim_height: float = 0.8) -> Building:
    """Return a flat roof behind a parapet of this width and height."""
    length, width, eave = 18.0, 12.0, 8.0
    outer, inner = box(length, width), box(length - 2 * rim, width - 2 * rim)
    faces = face_over(outer - inner, (0.0, 0.0, eave + rim_height)), face_over(inner, (0.0, 0.0, eave))
    return building_of("parapet", faces)


def _moved(face: RoofFace, x: float, y: float) -> RoofFace:
    a, b, c = face.plane
    return RoofFace(tuple(ring + np.array([x, y]) for ring in face.rings), (a, b, c - a * x - b * y))
