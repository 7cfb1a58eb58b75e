"""The scene as flat tables, listed in a grid, so that a beam finds what it may hit."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.simulation.building import Building
from lidar_buildings.simulation.scene import VirtualScene
from lidar_buildings.simulation.shell import walls_of

#: Side of the grid's cells [m].
CELL = 4.0
#: Outer walls reach this far under the foot, so that no gap opens on a slope [m].
FOUNDATION = 10.0
#: Footprints reach no farther than this [m].
SLACK = 2.0
#: Rows of `Surfaces.cell_start`.
FACES, WALLS, CROWNS, ROADS = range(4)

#: A roof face: its plane z = a·x + b·y + c, its bounds, and its rows of `EDGE`.
FACE = np.dtype(
    [(name, "f8") for name in ("a", "b", "c", "x_from", "x_to", "y_from", "y_to")]
    + [("first_edge", "i8"), ("last_edge", "i8"), ("building", "i8"), ("plane_id", "i8")]
)
#: A side of a roof face, or a wall's or a road's axis, runs from x_0, y_0 to x_1, y_1.
EDGE = np.dtype([(name, "f8") for name in ("x_0", "y_0", "x_1", "y_1")])
WALL = np.dtype(
    [*EDGE.descr, *((name, "f8") for name in ("bottom_0", "bottom_1", "top_0", "top_1")), ("building", "i8")]
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


def surfaces_of(scene: VirtualScene, max_scan_angle_deg: float) -> Surfaces:
    """Flatten a scene for beams that lean at most by this angle."""
    lean = float(np.tan(np.deg2rad(max_scan_angle_deg)))
    solids = (*scene.buildings, *scene.obstacles)
    faces, edges, face_height = _faces(solids)
    walls, wall_height = _walls(solids)
    crowns = np.array(
        [(t.x, t.y, t.crown_elevation, t.crown_radius, t.crown_half_height) for t in scene.trees], dtype=CROWN
    )
    roads = np.array([(*road.start, *road.end, road.width / 2) for road in scene.roads], dtype=ROAD)
    columns, rows = (int(np.ceil(extent / CELL)) for extent in scene.size)
    bounds = [
        np.column_stack([faces["x_from"], faces["x_to"], faces["y_from"], faces["y_to"]]),
        _axis_bounds(walls),
        _crown_bounds(crowns),
        _axis_bounds(roads),
    ]
    reach = [
        (face_height + FOUNDATION) * lean,
        (wall_height + FOUNDATION) * lean,
        (2 * crowns["half_height"] + FOUNDATION) * lean,
        roads["half_width"],
    ]
    start, items = _cells(columns, rows, bounds, reach)
    return Surfaces(
        scene.terrain.coefficients(), faces, edges, walls, crowns, roads, columns, rows, start, items
    )


def _faces(solids: tuple[Building, ...]) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.float64]]:
    """Tables of roof faces and of their edges, and the height of each face's building."""
    faces, edges, height = [], [], []
    for solid in solids:
        for plane_id, face in enumerate(solid.faces, start=1):
            first = len(edges)
            for ring in face.rings:
                edges.extend(
                    (*start, *end) for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True)
                )
            x_from, y_from, x_to, y_to = face.polygon.bounds
            number = (solid.number, plane_id) if solid.number else (0, 0)
            faces.append((*face.plane, x_from, x_to, y_from, y_to, first, len(edges), *number))
            height.append(solid.height)
    return np.array(faces, dtype=FACE), np.array(edges, dtype=EDGE), np.array(height, dtype=np.float64)


def _walls(solids: tuple[Building, ...]) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Table of walls, outer ones with their foundation, and the height of each wall's building."""
    walls, height = [], []
    for solid in solids:
        for wall in walls_of(solid):
            below = FOUNDATION if wall.outer else 0.0
            bottom = wall.bottom[0] - below, wall.bottom[1] - below
            walls.append((*wall.start, *wall.end, *bottom, *wall.top, solid.number))
            height.append(solid.height)
    return np.array(walls, dtype=WALL), np.array(height, dtype=np.float64)


def _axis_bounds(table: NDArray[Any]) -> NDArray[np.float64]:
    x, y = np.stack([table["x_0"], table["x_1"]]), np.stack([table["y_0"], table["y_1"]])
    return np.column_stack([x.min(axis=0), x.max(axis=0), y.min(axis=0), y.max(axis=0)])


def _crown_bounds(crowns: NDArray[Any]) -> NDArray[np.float64]:
    x, y, radius = crowns["x"], crowns["y"], crowns["radius"]
    return np.column_stack([x - radius, x + radius, y - radius, y + radius])


def _cells(
    columns: int, rows: int, bounds: list[NDArray[np.float64]], reach: list[NDArray[np.float64]]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """List in every cell the rows of each table whose bounds, grown by their reach, meet it."""
    n_cells = columns * rows
    start = np.zeros((len(bounds), n_cells + 1), dtype=np.int64)
    items: list[int] = []
    for table in range(len(bounds)):
        cells = _rows_per_cell(columns, rows, bounds[table], reach[table])
        start[table] = len(items) + np.concatenate([[0], np.cumsum([len(cell) for cell in cells])])
        items.extend(row for cell in cells for row in cell)
    return start, np.array(items, dtype=np.int64)


def _rows_per_cell(
    columns: int, rows: int, bounds: NDArray[np.float64], reach: NDArray[np.float64]
) -> list[list[int]]:
    """The rows of one table that meet each cell."""
    cells: list[list[int]] = [[] for _ in range(columns * rows)]
    grown = reach[:, None] + SLACK
    low = np.maximum(np.floor((bounds[:, [0, 2]] - grown) / CELL).astype(int), 0)
    high = np.minimum(np.floor((bounds[:, [1, 3]] + grown) / CELL).astype(int), (columns - 1, rows - 1))
    for item in range(len(bounds)):
        for row in range(low[item, 1], high[item, 1] + 1):
            for column in range(low[item, 0], high[item, 0] + 1):
                cells[row * columns + column].append(item)
    return cells
