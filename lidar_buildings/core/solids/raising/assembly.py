"""The faces of a roof, its walls and its ground, put together from a plan and its columns."""

from __future__ import annotations

import numpy as np
import shapely

from lidar_buildings.core.solids.output_grid import GRID
from lidar_buildings.core.solids.raising.plan_graph import OUTSIDE, Vertex, doubled_area
from lidar_buildings.core.solids.raising.vertex_columns import VertexColumns
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE, Face, Solid

#: A point of the grid in space.
_Corner = tuple[int, int, int]


class _Shell:
    """Faces as they are found, with one row per corner."""

    def __init__(self) -> None:
        self.rows: dict[_Corner, int] = {}
        self.faces: list[Face] = []
        self.semantics: list[str] = []

    def add(self, kind: str, *rings: list[_Corner]) -> None:
        """Add a face."""
        self.faces.append(
            tuple(tuple(self.rows.setdefault(corner, len(self.rows)) for corner in ring) for ring in rings)
        )
        self.semantics.append(kind)

    def solid(self) -> Solid:
        """Return the solid of all faces."""
        vertices = np.array(list(self.rows), dtype=np.float64).reshape(-1, 3) / round(1 / GRID)
        return Solid(vertices, tuple(self.faces), tuple(self.semantics))


def assemble(columns: VertexColumns) -> Solid:
    """Return the solid: ground faces, roof faces and a wall for each edge where elevations differ."""
    shell = _Shell()
    rings = columns.graph.rings()
    for face in _faces(rings.pop(OUTSIDE, []), sign=-1):
        shell.add(GROUND_SURFACE, *([(x, y, columns.ground) for x, y in ring] for ring in face))
    for piece in sorted(rings):
        for face in _faces(rings[piece], sign=1):
            roof = [[(*vertex, columns.level(vertex, piece)) for vertex in ring] for ring in face]
            shell.add(ROOF_SURFACE, *roof)
    for start, end in sorted(columns.graph.left):
        wall = _wall(columns, start, end)
        if wall:
            shell.add(WALL_SURFACE, wall)
    return shell.solid()


def _wall(columns: VertexColumns, start: Vertex, end: Vertex) -> list[_Corner]:
    """Return the wall above an edge if what is to its left is higher than what is to its right."""
    left, right = columns.graph.left[start, end], columns.graph.left[end, start]
    (low_a, high_a), (low_b, high_b) = (
        (columns.level(vertex, right), columns.level(vertex, left)) for vertex in (start, end)
    )
    if low_a > high_a or low_b > high_b or (low_a == high_a and low_b == high_b):
        return []
    up = [(*end, z) for z in columns.stack(end) if low_b <= z <= high_b]
    down = [(*start, z) for z in reversed(columns.stack(start)) if low_a <= z <= high_a]
    return [down[-1], *up, *down[:-1]]


def _faces(rings: list[list[Vertex]], sign: int) -> list[list[list[Vertex]]]:
    """Return each exterior with the holes inside it; exteriors are the rings whose area has a sign."""
    exteriors = [ring for ring in rings if sign * doubled_area(ring) > 0]
    holes = [ring for ring in rings if sign * doubled_area(ring) < 0]
    if len(exteriors) <= 1:
        return [[exterior, *holes] for exterior in exteriors]
    polygons = [shapely.Polygon(exterior) for exterior in exteriors]
    faces = [[exterior] for exterior in exteriors]
    for hole in holes:
        inside = shapely.Polygon(hole).representative_point()
        owners = [k for k, polygon in enumerate(polygons) if polygon.contains(inside)]
        if owners:
            faces[min(owners, key=lambda k: polygons[k].area)].append(hole)
    return faces
