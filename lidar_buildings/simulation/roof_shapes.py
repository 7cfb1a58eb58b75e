"""Roof shapes: each function returns a building centred on the origin, length along x, foot at z = 0."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.simulation.building import GRID, Building, RoofFace, building_of, face_over
from lidar_buildings.simulation.roof_cutting import box, gable_faces, highest_of, lowest, rim_planes, slope_of

#: Width of the wings of L- and T-shaped houses [m].
WING_WIDTH = 7.0


def flat(length: float = 14.0, width: float = 10.0, eave: float = 6.0) -> Building:
    """Return a box."""
    return building_of("flat", (face_over(box(length, width), (0.0, 0.0, eave)),))


def shed(length: float = 12.0, width: float = 8.0, eave: float = 4.0, pitch_deg: float = 15.0) -> Building:
    """Return a building with one sloping face that rises towards +y."""
    slope = slope_of(pitch_deg)
    return building_of("shed", (face_over(box(length, width), (0.0, slope, eave + slope * width / 2)),))


def gable(length: float = 14.0, width: float = 9.0, eave: float = 5.0, pitch_deg: float = 35.0) -> Building:
    """Return a building with a ridge along x from wall to wall."""
    return building_of("gable", gable_faces(box(length, width), width / 2, eave, slope_of(pitch_deg)))


def hip(length: float = 15.0, width: float = 10.0, eave: float = 5.0, pitch_deg: float = 35.0) -> Building:
    """Return a building whose four faces have the same pitch; a pyramid if it is square."""
    return building_of(
        "hip", lowest(box(length, width), rim_planes(length, width, eave, slope_of(pitch_deg)))
    )


def l_shape(length: float = 16.0, wing_length: float = 7.0, pitch_deg: float = 35.0) -> Building:
    """Return a gable house with a lower gable wing at its eastern end; flat if `pitch_deg` is 0."""
    return _winged("l_shape", length, wing_length, (length - WING_WIDTH) / 2, pitch_deg)


def t_shape(length: float = 18.0, wing_length: float = 7.0, pitch_deg: float = 35.0) -> Building:
    """Return a gable house with a lower gable wing in the middle towards −y; flat if `pitch_deg` is 0."""
    return _winged("t_shape", length, wing_length, 0.0, pitch_deg)


def step(
    length: float = 18.0, width: float = 10.0, eave: float = 4.0, step_height: float = 3.5, share: float = 0.5
) -> Building:
    """Return two flat roofs side by side; the western `share` of the length is the lower one."""
    x = length * (share - 0.5)
    low = shapely.box(-length / 2, -width / 2, x, width / 2)
    high = shapely.box(x, -width / 2, length / 2, width / 2)
    return building_of("step", (face_over(low, (0, 0, eave)), face_over(high, (0, 0, eave + step_height))))


def dormer(
    length: float = 16.0,
    width: float = 11.0,
    eave: float = 5.0,
    dormer_height: float = 2.2,
    setback: float = 1.0,
) -> Building:
    """
    Return a gable house with a flat dormer on its southern face, its front `setback` behind the eave.

    ValueError if the dormer would reach the ridge.
    """
    dormer_width = 5.0
    slope = slope_of(40.0)
    front = -width / 2 + setback
    top = eave + slope * setback + dormer_height
    back = front + dormer_height / slope
    if back >= 0:
        raise ValueError(
            f"dormer_height = {dormer_height:g} m: must be less than {-front * slope:.2f} m here"
        )
    cut = shapely.box(-dormer_width / 2, front, dormer_width / 2, back)
    south, north = gable_faces(box(length, width), width / 2, eave, slope)
    return building_of(
        "dormer", (face_over(south.polygon - cut, south.plane), north, face_over(cut, (0.0, 0.0, top)))
    )


def courtyard(
    length: float = 30.0, width: float = 24.0, depth: float = 8.0, eave: float = 8.0, pitch_deg: float = 0.0
) -> Building:
    """Return four wings of this depth round a court; flat, or with a ridge along the middle of each wing."""
    outer, inner = box(length, width), box(length - 2 * depth, width - 2 * depth)
    slope = slope_of(pitch_deg)
    if slope == 0:
        return building_of("courtyard", (face_over(outer - inner, (0.0, 0.0, eave)),))
    middle = box(length - depth, width - depth)
    outward = lowest(outer - middle, rim_planes(length, width, eave, slope))
    court_rim = rim_planes(length - 2 * depth, width - 2 * depth, eave, -slope)
    inward = lowest(middle - inner, court_rim, highest=True)
    return building_of("courtyard", outward + inward)


def round_tower(
    diameter: float = 12.0, eave: float = 12.0, pitch_deg: float = 0.0, n_sides: int = 32
) -> Building:
    """Return a regular prism, round for all that a scanner sees, with a flat roof or a pointed one."""
    angle = 2 * np.pi * np.arange(n_sides) / n_sides
    rim = np.round(diameter / 2 * np.column_stack([np.cos(angle), np.sin(angle)]) / GRID) * GRID
    slope = slope_of(pitch_deg)
    if slope == 0:
        return building_of("round_tower", (face_over(shapely.Polygon(rim), (0.0, 0.0, eave)),))
    apex = eave + slope * diameter / 2
    sides = zip(rim, np.roll(rim, -1, axis=0), strict=True)
    return building_of("round_tower", tuple(_side_of_cone(a, b, eave, apex) for a, b in sides))


def _winged(roof_type: str, length: float, wing_length: float, wing_x: float, pitch_deg: float) -> Building:
    """Join a gable house and a gable wing whose axis is the line x = `wing_x`."""
    width, eave = 9.0, 5.0
    main = box(length, width)
    end = -width / 2 - wing_length
    wing = shapely.box(wing_x - WING_WIDTH / 2, end, wing_x + WING_WIDTH / 2, 0.0)
    slope = slope_of(pitch_deg)
    if slope == 0:
        return building_of(roof_type, (face_over(main | wing, (0.0, 0.0, eave)),))
    top = eave + slope * WING_WIDTH / 2
    wing_planes = [(slope, 0.0, top - slope * wing_x), (-slope, 0.0, top + slope * wing_x)]
    faces = highest_of(gable_faces(main, width / 2, eave, slope), lowest(wing, wing_planes))
    return building_of(roof_type, faces)


def _side_of_cone(a: NDArray[np.float64], b: NDArray[np.float64], eave: float, apex: float) -> RoofFace:
    """The triangle between a side of the rim and the apex over the origin."""
    corners = np.array([[*a, 1.0], [*b, 1.0], [0.0, 0.0, 1.0]])
    plane = np.linalg.solve(corners, [eave, eave, apex])
    return RoofFace((np.array([a, b, [0.0, 0.0]]),), (float(plane[0]), float(plane[1]), float(plane[2])))
