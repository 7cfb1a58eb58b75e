"""
The scene as flat tables, listed in a grid, and what a single beam hits of it.

A beam is the line x = foot_x + lean_x · (top − z), and the same for y: it starts at the scanner's elevation
`top` over (foot_x, foot_y) and only descends, so the hit of highest z is the first one. Compiled functions
take it as the tuple (foot_x, foot_y, top, lean_x, lean_y), and the scene as `Surfaces` turned into a plain
tuple: numba cannot read its cache any more once the class of a named one has gone.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.simulation.facades import SurfaceKind, parts_of
from lidar_buildings.simulation.scene import VirtualScene, terrain_elevation

#: Side of the grid's cells [m].
CELL = 4.0
#: Outer walls reach this far under the foot, so that no gap opens on a slope [m].
FOUNDATION = 10.0
#: Footprints of beams reach no farther than this [m].
SLACK = 2.0
#: Rows of `Surfaces.cell_start`.
FACES, WALLS, CROWNS, ROADS = range(4)

#: A roof face or soffit: its plane z = a·x + b·y + c, its bounds, its rows of `EDGE`, its `SurfaceKind`, the
#: number of the part of the scene to which it belongs (0: none), and whether it is seen from above (1) or
#: below (−1).
FACE = np.dtype(
    [(name, "f8") for name in ("a", "b", "c", "x_from", "x_to", "y_from", "y_to")]
    + [(name, "i8") for name in ("first_edge", "last_edge", "building", "plane_id", "surface", "part")]
    + [("side", "f8")]
)
#: A side of a roof face, or a wall's or a road's axis, runs from x_0, y_0 to x_1, y_1.
EDGE = np.dtype([(name, "f8") for name in ("x_0", "y_0", "x_1", "y_1")])
WALL = np.dtype(
    [*EDGE.descr, *((name, "f8") for name in ("bottom_0", "bottom_1", "top_0", "top_1"))]
    + [(name, "i8") for name in ("building", "surface", "part")]
)
CROWN = np.dtype([(name, "f8") for name in ("x", "y", "z", "radius", "half_height")])
ROAD = np.dtype([*EDGE.descr, ("half_width", "f8")])


class Surfaces(NamedTuple):
    """Everything that a beam can hit."""

    terrain: NDArray[np.float64]  #: as `Terrain.coefficients` gives it
    #: Their fields are described at `FACE`, `EDGE`, `WALL`, `CROWN` and `ROAD`; building 0 is an obstacle.
    faces: NDArray[Any]
    edges: NDArray[Any]
    walls: NDArray[Any]
    crowns: NDArray[Any]
    roads: NDArray[Any]
    #: Size of the grid.
    columns: int
    rows: int
    #: The faces (walls, …) that beams to cell i may hit are the rows
    #: ``cell_items[cell_start[FACES, i]:cell_start[FACES, i + 1]]``.
    cell_start: NDArray[np.int64]
    cell_items: NDArray[np.int64]


#: Members that compiled code takes from `tuple(surfaces)` by their place.
TERRAIN, CELL_START = Surfaces._fields.index("terrain"), Surfaces._fields.index("cell_start")
WALL_TABLE = Surfaces._fields.index("walls")


def surfaces_of(scene: VirtualScene, max_scan_angle_deg: float, slack: float = SLACK) -> Surfaces:
    """Flatten a scene for beams that lean at most by this angle and whose footprints reach so far [m]."""
    lean = float(np.tan(np.deg2rad(max_scan_angle_deg)))
    faces, edges, face_height, walls, wall_height = _solids(scene)
    crowns = np.array(
        [(t.x, t.y, t.crown_elevation, t.crown_radius, t.crown_half_height) for t in scene.trees], dtype=CROWN
    )
    roads = np.array([(*road.start, *road.end, road.width / 2) for road in scene.roads], dtype=ROAD)
    columns, rows = (int(np.ceil(extent / CELL)) for extent in scene.size)
    x, y, radius = crowns["x"], crowns["y"], crowns["radius"]
    bounds = [
        np.column_stack([faces["x_from"], faces["x_to"], faces["y_from"], faces["y_to"]]),
        _axis_bounds(walls),
        np.column_stack([x - radius, x + radius, y - radius, y + radius]),
        _axis_bounds(roads),
    ]
    reach = [
        (face_height + FOUNDATION) * lean,
        (wall_height + FOUNDATION) * lean,
        (2 * crowns["half_height"] + FOUNDATION) * lean,
        roads["half_width"],
    ]
    start, items = _cells(columns, rows, bounds, [one + slack for one in reach])
    return Surfaces(
        scene.terrain.coefficients(), faces, edges, walls, crowns, roads, columns, rows, start, items
    )


def _solids(scene: VirtualScene) -> tuple[NDArray[Any], ...]:
    """Tables of faces, their edges and walls, and the height of each face's and each wall's building."""
    faces: list[tuple[float, ...]] = []
    edges: list[tuple[float, ...]] = []
    walls: list[tuple[float, ...]] = []
    face_height, wall_height, n_parts = [], [], 0
    for solid in (*scene.buildings, *scene.obstacles):
        made = parts_of(solid)
        for slab in made.slabs:
            first = len(edges)
            for ring in slab.face.rings:
                edges.extend(map(tuple, np.column_stack([ring, np.roll(ring, -1, axis=0)])))
            x_from, y_from, x_to, y_to = slab.face.polygon.bounds
            number = 0 if slab.surface == SurfaceKind.PAVEMENT else solid.number  # the floor of an arcade
            owner = number, slab.plane_id if number else 0
            part = n_parts + 1 + slab.part if slab.part >= 0 else 0
            place = (*slab.face.plane, x_from, x_to, y_from, y_to, first, len(edges))
            faces.append((*place, *owner, slab.surface, part, slab.side))
            face_height.append(solid.height)
        for panel in made.panels:
            part = n_parts + 1 + panel.part if panel.part >= 0 else 0
            bottom = np.subtract(panel.bottom, FOUNDATION if panel.is_grounded else 0.0)
            place = (*panel.start, *panel.end, *bottom, *panel.top)
            walls.append((*place, solid.number, panel.surface, part))
            wall_height.append(solid.height)
        n_parts += len(made.parts)
    return (
        *(np.array(faces, dtype=FACE), np.array(edges, dtype=EDGE), np.array(face_height, dtype=np.float64)),
        *(np.array(walls, dtype=WALL), np.array(wall_height, dtype=np.float64)),
    )


def _axis_bounds(table: NDArray[Any]) -> NDArray[np.float64]:
    x, y = np.stack([table["x_0"], table["x_1"]]), np.stack([table["y_0"], table["y_1"]])
    return np.column_stack([x.min(axis=0), x.max(axis=0), y.min(axis=0), y.max(axis=0)])


def _cells(
    columns: int, rows: int, bounds: list[NDArray[np.float64]], reach: list[NDArray[np.float64]]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """List in every cell the rows of each table whose bounds, grown by their reach, meet it."""
    start = np.zeros((len(bounds), columns * rows + 1), dtype=np.int64)
    items: list[int] = []
    for table, (own, grown) in enumerate(zip(bounds, reach, strict=True)):
        cells: list[list[int]] = [[] for _ in range(columns * rows)]
        low = np.maximum(np.floor((own[:, [0, 2]] - grown[:, None]) / CELL).astype(int), 0)
        high = np.minimum(
            np.floor((own[:, [1, 3]] + grown[:, None]) / CELL).astype(int), (columns - 1, rows - 1)
        )
        for item in range(len(own)):
            for row in range(low[item, 1], high[item, 1] + 1):
                for column in range(low[item, 0], high[item, 0] + 1):
                    cells[row * columns + column].append(item)
        start[table] = len(items) + np.concatenate([[0], np.cumsum([len(cell) for cell in cells])])
        items.extend(row for cell in cells for row in cell)
    return start, np.array(items, dtype=np.int64)


#: Kinds of surface.
ON_TERRAIN, ON_ROOF, ON_WALL = np.arange(3)
#: Row of what has no table, such as the terrain; an int64 as rows are, for kernels that are compiled once.
NO_ROW = np.int64(-1)
#: The terrain is found to this [m] by fixed-point iteration; slope · lean < 0.1 gains a digit in each round.
TERRAIN_TOLERANCE, TERRAIN_ROUNDS = 1e-4, 10
#: A face is missed by beams along it: cosine-like measure of how much it faces the beam.
MIN_FACING = 0.02


@kernel
def cell_of(x, y, columns, rows):
    """Number of the grid cell at a position within the scene."""
    return min(int(y / CELL), rows - 1) * columns + min(int(x / CELL), columns - 1)


@kernel
def position_at(beam, z):
    """Where the beam is at an elevation."""
    foot_x, foot_y, top, lean_x, lean_y = beam
    return foot_x + lean_x * (top - z), foot_y + lean_y * (top - z)


@kernel
def terrain_hit(beam, guess, terrain):
    """Elevation at which the beam meets the terrain [m], from a first guess."""
    z = guess
    for _ in range(TERRAIN_ROUNDS):
        before = z
        x, y = position_at(beam, z)
        z = terrain_elevation(x, y, terrain)
        if abs(z - before) < TERRAIN_TOLERANCE:
            break
    return z


@kernel
def first_hit(beam, cell, terrain_z, surfaces):
    """Elevation, kind of surface and its row for the first solid thing on the beam."""
    _, faces, edges, walls, _, _, _, _, start, items = surfaces
    best, kind, row = terrain_z, ON_TERRAIN, NO_ROW
    for place in range(start[FACES, cell], start[FACES, cell + 1]):
        face = items[place]
        z = face_hit(beam, faces[face], edges, 1.0)
        if z > best:
            best, kind, row = z, ON_ROOF, face
    for place in range(start[WALLS, cell], start[WALLS, cell + 1]):
        wall = items[place]
        z = wall_hit(beam, walls[wall])
        if z > best:
            best, kind, row = z, ON_WALL, wall
    return best, kind, row


@kernel
def face_hit(beam, face, edges, sense):
    """Elevation at which a beam that falls (sense 1) or rises (−1) meets a face, −∞ if it does not."""
    _, _, _, lean_x, lean_y = beam
    facing = 1.0 + face.a * lean_x + face.b * lean_y
    if face.side * sense * facing < MIN_FACING:
        return -np.inf
    x_at_zero, y_at_zero = position_at(beam, 0.0)
    z = (face.a * x_at_zero + face.b * y_at_zero + face.c) / facing
    x, y = position_at(beam, z)
    if x < face.x_from or x > face.x_to or y < face.y_from or y > face.y_to:
        return -np.inf
    inside = False
    for row in range(face.first_edge, face.last_edge):
        edge = edges[row]
        if (edge.y_0 > y) != (edge.y_1 > y):
            inside ^= x < edge.x_0 + (edge.x_1 - edge.x_0) * (y - edge.y_0) / (edge.y_1 - edge.y_0)
    return z if inside else -np.inf


@kernel
def wall_hit(beam, wall):
    """Elevation at which the beam meets a wall, −∞ if it does not."""
    foot_x, foot_y, beam_top, lean_x, lean_y = beam
    edge_x, edge_y = wall.x_1 - wall.x_0, wall.y_1 - wall.y_0
    crossing = lean_x * edge_y - lean_y * edge_x
    if abs(crossing) < 1e-9:
        return -np.inf
    to_x, to_y = wall.x_0 - foot_x, wall.y_0 - foot_y
    share = (to_x * lean_y - to_y * lean_x) / crossing
    if share < 0.0 or share > 1.0:
        return -np.inf
    z = beam_top - (to_x * edge_y - to_y * edge_x) / crossing
    bottom = wall.bottom_0 + share * (wall.bottom_1 - wall.bottom_0)
    top = wall.top_0 + share * (wall.top_1 - wall.top_0)
    return z if bottom < z < top else -np.inf


@kernel
def next_crown(beam, cell, below, surfaces):
    """Entry and exit [m] of the next crown that the beam enters below an elevation; −∞ if there is none."""
    _, _, _, _, crowns, _, _, _, start, items = surfaces
    best, best_exit = -np.inf, -np.inf
    for place in range(start[CROWNS, cell], start[CROWNS, cell + 1]):
        entry, leaving = crown_crossing(beam, crowns[items[place]])
        if best < entry < below:
            best, best_exit = entry, leaving
    return best, best_exit


@kernel
def crown_crossing(beam, crown):
    """Elevations at which the beam enters and leaves an ellipsoid, −∞ if it misses it."""
    _, _, _, lean_x, lean_y = beam
    x, y = position_at(beam, crown.z)
    x, y = (x - crown.x) / crown.radius, (y - crown.y) / crown.radius
    dx, dy, dz = -lean_x / crown.radius, -lean_y / crown.radius, 1.0 / crown.half_height
    a, half_b, c = dx * dx + dy * dy + dz * dz, x * dx + y * dy, x * x + y * y - 1.0
    discriminant = half_b * half_b - a * c
    if discriminant <= 0.0:
        return -np.inf, -np.inf
    root = np.sqrt(discriminant)
    return crown.z + (root - half_b) / a, crown.z - (root + half_b) / a


@kernel
def on_road(x, y, cell, surfaces):
    """Whether a position lies on a road."""
    _, _, _, _, _, roads, _, _, start, items = surfaces
    for place in range(start[ROADS, cell], start[ROADS, cell + 1]):
        road = roads[items[place]]
        dx, dy = road.x_1 - road.x_0, road.y_1 - road.y_0
        length = np.hypot(dx, dy)
        along = ((x - road.x_0) * dx + (y - road.y_0) * dy) / length
        aside = abs((x - road.x_0) * dy - (y - road.y_0) * dx) / length
        if 0.0 <= along <= length and aside <= road.half_width:
            return True
    return False
