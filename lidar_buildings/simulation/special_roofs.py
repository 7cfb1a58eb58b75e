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


def half_hip(
    length: float = 15.0, width: float = 10.0, eave: float = 5.0, pitch_deg: float = 40.0, share: float = 0.5
) -> Building:
    """Return a gable house whose gables end in small hips, which begin at this share of the roof's height."""
    slope = slope_of(pitch_deg)
    top = eave + slope * width / 2
    end = eave + share * slope * width / 2 + slope * length / 2
    planes = [(0.0, slope, top), (0.0, -slope, top), (slope, 0.0, end), (-slope, 0.0, end)]
    return building_of("half_hip", lowest(box(length, width), planes))


def pyramid(side: float = 10.0, eave: float = 5.0, pitch_deg: float = 35.0) -> Building:
    """Return a square building whose four faces meet in one point."""
    return building_of("pyramid", lowest(box(side, side), rim_planes(side, side, eave, slope_of(pitch_deg))))


def gambrel(
    length: float = 14.0,
    width: float = 10.0,
    eave: float = 4.0,
    lower_pitch_deg: float = 60.0,
    upper_pitch_deg: float = 25.0,
    break_width: float = 1.8,
) -> Building:
    """Return a gable house whose faces are steep near the eaves, over this width, and flatter above."""
    steep, slope = slope_of(lower_pitch_deg), slope_of(upper_pitch_deg)
    low = eave + steep * width / 2
    high = eave + steep * break_width + slope * (width / 2 - break_width)
    planes = [(0.0, steep, low), (0.0, slope, high), (0.0, -slope, high), (0.0, -steep, low)]
    return building_of("gambrel", lowest(box(length, width), planes))


def mansard(
    length: float = 16.0,
    width: float = 12.0,
    eave: float = 7.0,
    pitch_deg: float = 60.0,
    break_width: float = 1.8,
) -> Building:
    """Return a building with steep faces on all four sides, this wide in plan, and a flat top."""
    slope = slope_of(pitch_deg)
    planes = [*rim_planes(length, width, eave, slope), (0.0, 0.0, eave + slope * break_width)]
    return building_of("mansard", lowest(box(length, width), planes))


def cross_gable(
    length: float = 18.0, width: float = 8.0, eave: float = 5.0, pitch_deg: float = 35.0
) -> Building:
    """Return two gable roofs of one size that cross in the middle, their ridges at one height."""
    top, slope = eave + slope_of(pitch_deg) * width / 2, slope_of(pitch_deg)
    along = gable_faces(box(length, width), width / 2, eave, slope)
    across = lowest(box(width, length), [(slope, 0.0, top), (-slope, 0.0, top)])
    return building_of("cross_gable", highest_of(along, across))


def hipped_l(
    length: float = 18.0, width: float = 8.0, depth: float = 16.0, eave: float = 5.0, pitch_deg: float = 35.0
) -> Building:
    """Return a hip roof over two wings of one width that make a corner in the south-west."""
    slope = slope_of(pitch_deg)
    wing = box(width, depth)
    first = lowest(box(length, width), rim_planes(length, width, eave, slope))
    second = lowest(wing, rim_planes(width, depth, eave, slope))
    shift = (width - length) / 2, (depth - width) / 2
    moved = tuple(_moved(face, *shift) for face in second)
    return building_of("hipped_l", joined(highest_of(first, moved)))


def double_gable(
    length: float = 14.0, width: float = 16.0, eave: float = 5.0, pitch_deg: float = 35.0
) -> Building:
    """Return two gable roofs side by side with a valley between: an M."""
    slope, quarter = slope_of(pitch_deg), width / 4
    faces: list[RoofFace] = []
    for y in (-quarter, quarter):
        half = gable_faces(box(length, width / 2), quarter, eave, slope)
        faces += [_moved(face, 0.0, y) for face in half]
    return building_of("double_gable", tuple(faces))


def gable_dormer(
    length: float = 16.0,
    width: float = 11.0,
    eave: float = 5.0,
    pitch_deg: float = 40.0,
    dormer_width: float = 4.0,
    dormer_eave: float = 1.8,
    dormer_pitch_deg: float = 30.0,
    setback: float = 0.8,
) -> Building:
    """Return a gable house with a gabled dormer to the south; `dormer_eave` is above the house's eave."""
    slope = slope_of(pitch_deg)
    rise = slope_of(dormer_pitch_deg) * dormer_width / 2
    # Eave and ridge of the dormer meet the face on the grid, so that neighbours share these corners.
    run = np.round(np.array([dormer_eave, dormer_eave + rise]) / slope / GRID) * GRID
    top = eave + float(run[1]) * slope
    pitch = float(run[1] - run[0]) * slope / (dormer_width / 2)
    cut = shapely.box(-dormer_width / 2, -width / 2 + setback, dormer_width / 2, 0.0)
    over = lowest(cut, [(pitch, 0.0, top), (-pitch, 0.0, top)])
    house = gable_faces(box(length, width), width / 2, eave, slope)
    return building_of("gable_dormer", highest_of(house, over))


def sawtooth(
    length: float = 24.0, width: float = 14.0, eave: float = 5.0, pitch_deg: float = 20.0, n_teeth: int = 4
) -> Building:
    """Return a hall of sheds in a row, each rising to the east and ending in an upright window."""
    slope, tooth = slope_of(pitch_deg), length / n_teeth
    west = -length / 2 + tooth * np.arange(n_teeth)
    faces = (
        face_over(shapely.box(x, -width / 2, x + tooth, width / 2), (slope, 0.0, eave - slope * x))
        for x in west.tolist()
    )
    return building_of("sawtooth", tuple(faces))


def barrel(
    length: float = 26.0, width: float = 16.0, eave: float = 5.0, rise: float = 4.0, n_facets: int = 12
) -> Building:
    """Return a hall under an arc, `rise` high in the middle, as facets of equal angle."""
    radius = (width**2 / 4 + rise**2) / (2 * rise)
    reach = np.arcsin(width / 2 / radius)
    angle = np.linspace(-reach, reach, n_facets + 1)
    y = np.round(radius * np.sin(angle) / GRID) * GRID
    z = eave + radius * (np.cos(angle) - np.cos(reach))
    slope = np.diff(z) / np.diff(y)
    faces = (
        face_over(
            shapely.box(-length / 2, y[k], length / 2, y[k + 1]), (0.0, slope[k], z[k] - slope[k] * y[k])
        )
        for k in range(n_facets)
    )
    return building_of("barrel", tuple(faces))


def church(
    length: float = 22.0,
    width: float = 11.0,
    eave: float = 8.0,
    pitch_deg: float = 50.0,
    tower: float = 6.0,
    tower_eave: float = 20.0,
    spire: float = 14.0,
) -> Building:
    """Return a steep gable nave with a square tower at its western end and a spire of this height on it."""
    nave = gable_faces(box(length, width), width / 2, eave, slope_of(pitch_deg))
    slope = spire / (tower / 2)
    top = lowest(box(tower, tower), rim_planes(tower, tower, tower_eave, slope))
    west = -(length + tower) / 2
    return building_of("church", (*nave, *(_moved(face, west, 0.0) for face in top)))


def parapet(
    length: float = 18.0, width: float = 12.0, eave: float = 8.0, rim: float = 0.5, rim_height: float = 0.8
) -> Building:
    """Return a flat roof behind a parapet of this width and height."""
    outer, inner = box(length, width), box(length - 2 * rim, width - 2 * rim)
    faces = face_over(outer - inner, (0.0, 0.0, eave + rim_height)), face_over(inner, (0.0, 0.0, eave))
    return building_of("parapet", faces)


def _moved(face: RoofFace, x: float, y: float) -> RoofFace:
    a, b, c = face.plane
    return RoofFace(tuple(ring + np.array([x, y]) for ring in face.rings), (a, b, c - a * x - b * y))
