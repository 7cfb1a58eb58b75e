"""
Roof shapes, plain and special, and how roofs are cut out of planes.

Each shape is a function that returns a building centred on the origin, length along x, foot at z = 0.
"""

from __future__ import annotations

import numpy as np
import shapely

from lidar_buildings.simulation.building import GRID, Building, RoofFace, building_of, face_over

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
            higher = _where_higher(other.plane, face.plane)
            above = shapely.intersection(other.polygon, higher, grid_size=GRID)
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
    planes = rim_planes(length, width, eave, slope_of(pitch_deg))
    return building_of("hip", lowest(box(length, width), planes))


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
        raise ValueError(f"dormer_height = {dormer_height:g} m: must be less than {-front * slope:.2f} m")
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
    faces = []
    for side in zip(rim, np.roll(rim, -1, axis=0), strict=True):
        triangle = np.array([*side, [0.0, 0.0]])
        a, b, c = np.linalg.solve(np.column_stack([triangle, np.ones(3)]), [eave, eave, apex]).tolist()
        faces.append(RoofFace((triangle,), (a, b, c)))
    return building_of("round_tower", tuple(faces))


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
    return building_of("pyramid", hip(10.0, 10.0).faces)


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
    length, width, depth = 18.0, 8.0, 16.0
    first, second = hip(length, width).faces, hip(width, depth).faces
    shift = (width - length) / 2, (depth - width) / 2
    moved = tuple(face.moved(*shift) for face in second)
    return building_of("hipped_l", joined(highest_of(first, moved)))


def double_gable() -> Building:
    """Return two gable roofs side by side with a valley between: an M."""
    width = 16.0
    slope, quarter = slope_of(35.0), width / 4
    half = gable_faces(box(14.0, width / 2), quarter, 5.0, slope)
    return building_of(
        "double_gable", tuple(face.moved(0.0, y) for y in (-quarter, quarter) for face in half)
    )


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
    strips = (shapely.box(-length / 2, y[k], length / 2, y[k + 1]) for k in range(n_facets))
    planes = ((0.0, slope[k], z[k] - slope[k] * y[k]) for k in range(n_facets))
    return building_of("barrel", tuple(map(face_over, strips, planes)))


def church() -> Building:
    """Return a steep gable nave with a square tower at its western end and a spire on it."""
    length, width, tower = 22.0, 11.0, 6.0
    nave = gable_faces(box(length, width), width / 2, 8.0, slope_of(50.0))
    slope = 14.0 / (tower / 2)
    top = lowest(box(tower, tower), rim_planes(tower, tower, 20.0, slope))
    west = -(length + tower) / 2
    return building_of("church", (*nave, *(face.moved(west, 0.0) for face in top)))


def parapet(rim: float = 0.5, rim_height: float = 0.8) -> Building:
    """Return a flat roof behind a parapet of this width and height."""
    length, width, eave = 18.0, 12.0, 8.0
    outer, inner = box(length, width), box(length - 2 * rim, width - 2 * rim)
    faces = face_over(outer - inner, (0.0, 0.0, eave + rim_height)), face_over(inner, (0.0, 0.0, eave))
    return building_of("parapet", faces)
