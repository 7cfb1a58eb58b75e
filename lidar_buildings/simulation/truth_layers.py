"""The truth as layers of a GeoPackage, and what a survey has seen of it."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.io.vectors.layers import VectorLayer, geopackage_file
from lidar_buildings.simulation.facades import OBSTACLES, Part, parts_of
from lidar_buildings.simulation.scanner import StripPoints
from lidar_buildings.simulation.scene import VirtualScene

#: A wall is seen where so many points lie on each piece of about this length [m].
SEEN_POINTS, PIECE = 5, 0.25

#: Columns of the layers.
OUTLINE_COLUMNS: dict[str, type] = {
    "building_number": int,
    "block_number": int,
    "roof_type": str,
    "ground_elevation": float,
    "roof_elevation_min": float,
    "roof_elevation_max": float,
    "height": float,
    "area": float,
    "n_planes": int,
}
FACE_COLUMNS: dict[str, type] = {"building_number": int, "plane_id": int, "slope_deg": float, "area": float}
WALL_COLUMNS: dict[str, type] = {
    "wall_id": int,
    "building_number": int,
    "kind": str,
    "z_low": float,
    "z_high": float,
    "length": float,
    "seen": int,
    "seen_share": float,
    "n_points": int,
}
OPENING_COLUMNS: dict[str, type] = {
    "building_number": int,
    "wall_id": int,
    "kind": str,
    "width": float,
    "height": float,
    "depth": float,
    "seen_share": float,
    "n_points": int,
}
EAVE_COLUMNS: dict[str, type] = {
    "building_number": int,
    "wall_id": int,
    "kind": str,
    "overhang": float,
    "thickness": float,
    "length": float,
    "seen_share": float,
    "n_points": int,
}
OBSTACLE_COLUMNS: dict[str, type] = {"kind": str, "z_low": float, "z_high": float}


class SeenParts:
    """
    Counts the points on each wall, opening and eave of a scene, in pieces of about 0.25 m along it.

    A piece is seen if at least 5 points per 0.25 m lie on it, those on windows and doors not counted for the
    wall; a piece of another length needs as many in proportion.
    """

    def __init__(self, scene: VirtualScene) -> None:
        made = [parts_of(building) for building in scene.buildings]
        offsets = np.concatenate([[0], np.cumsum([len(one.parts) for one in made])]).tolist()
        self.parts: list[Part] = [part for one in made for part in one.parts]
        #: Row of each part's wall within all parts; −1 for none.
        self.walls = [
            part.wall + offset if part.wall >= 0 else -1
            for one, offset in zip(made, offsets, strict=False)
            for part in one.parts
        ]
        self._start = np.array([part.start for part in self.parts]).reshape(-1, 2)
        span = np.array([part.end for part in self.parts]).reshape(-1, 2) - self._start
        self._length = np.maximum(np.hypot(*span.T), 1e-9)
        self._along = span / self._length[:, None]
        self._n_pieces = np.maximum(np.rint(self._length / PIECE).astype(np.int64), 1)
        self._first = np.concatenate([[0], np.cumsum(self._n_pieces)])
        self._counts = np.zeros(self._first[-1], dtype=np.int64)

    def add(self, strip: StripPoints) -> None:
        """Count points."""
        rows = np.flatnonzero(strip.true_part)
        part = strip.true_part[rows].astype(np.int64) - 1
        along = ((strip.points[rows, :2] - self._start[part]) * self._along[part]).sum(axis=1)
        piece = np.floor(along / self._length[part] * self._n_pieces[part]).astype(np.int64)
        piece = self._first[part] + np.clip(piece, 0, self._n_pieces[part] - 1)
        self._counts += np.bincount(piece, minlength=len(self._counts))

    def pieces_of(self, row: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the number of points on each piece of a part, and whether it is seen."""
        counts = self._counts[self._first[row] : self._first[row + 1]]
        return counts, counts >= SEEN_POINTS * self._length[row] / self._n_pieces[row] / PIECE


def seen_wall_pieces(seen: SeenParts) -> list[tuple[shapely.LineString, dict[str, Any]]]:
    """Return every wall cut where it begins or ceases to be seen, and its attributes, in the map frame."""
    found = []
    for row, part in enumerate(seen.parts):
        if part.layer != "walls":
            continue
        counts, is_seen = seen.pieces_of(row)
        share = float(is_seen.mean())
        start, step = np.array(part.start), (np.array(part.end) - part.start) / len(counts)
        first = 0
        for seen_now, run in groupby(is_seen):
            last = first + len(list(run))
            line = shapely.LineString([start + first * step, start + last * step])
            row_of = {
                "wall_id": row + 1,
                "building_number": part.building,
                "kind": part.kind,
                "z_low": part.low,
                "z_high": part.high,
                "length": line.length,
                "seen": int(seen_now),
                "seen_share": share,
                "n_points": int(counts[first:last].sum()),
            }
            found.append((line, row_of))
            first = last
    return found


def write_truth_layers(path: Path, scene: VirtualScene, seen: SeenParts | None = None) -> None:
    """Write roofprints, roof faces in 3D, walls, openings, eaves and obstacles."""
    seen = SeenParts(scene) if seen is None else seen
    with geopackage_file(path, scene.frame.crs) as add:
        for layer in (_outlines(scene), _roof_faces(scene), *_parts(scene, seen), _obstacles(scene)):
            add(layer)


def building_attributes(scene: VirtualScene) -> list[dict[str, Any]]:
    """Return one row per building; elevations in the source's reference system [m]."""
    if not scene.buildings:
        return []
    zero, rows = scene.frame.origin[2], []
    for building, block in zip(scene.buildings, scene.blocks().tolist(), strict=True):  # of touching ones
        low, high = building.roof_elevation_range
        values = (
            *(building.number, block, building.roof_type, building.ground_elevation + zero, low + zero),
            *(high + zero, building.height, building.outline.area, len(building.faces)),
        )
        rows.append(dict(zip(OUTLINE_COLUMNS, values, strict=True)))
    return rows


def _outlines(scene: VirtualScene) -> VectorLayer:
    outlines = [_polygon(b.outline.rings, scene) for b in scene.buildings]
    return VectorLayer("outlines", outlines, OUTLINE_COLUMNS, building_attributes(scene))


def _roof_faces(scene: VirtualScene) -> VectorLayer:
    faces = [_polygon(face.rings_3d, scene) for b in scene.buildings for face in b.faces]
    rows = [
        {
            "building_number": building.number,
            "plane_id": plane_id,
            "slope_deg": float(np.rad2deg(np.arccos(face.normal[2]))),
            "area": float(face.polygon.area / face.normal[2]),  # true, inclined
        }
        for building in scene.buildings
        for plane_id, face in enumerate(building.faces, start=1)
    ]
    return VectorLayer("roof_faces", faces, FACE_COLUMNS, rows, "Polygon Z")


def _parts(scene: VirtualScene, seen: SeenParts) -> tuple[VectorLayer, ...]:
    zero = scene.frame.origin[2]
    walls = seen_wall_pieces(seen)
    lines = [shapely.transform(line, lambda xy: xy + scene.frame.origin[:2]) for line, _ in walls]
    rows = [{**row, "z_low": row["z_low"] + zero, "z_high": row["z_high"] + zero} for _, row in walls]
    openings, opening_rows, eaves, eave_rows = [], [], [], []
    for number, part in enumerate(seen.parts):
        if part.layer == "walls":
            continue
        counts, is_seen = seen.pieces_of(number)
        (x_0, y_0), (x_1, y_1) = part.start, part.end
        row = {
            "building_number": part.building,
            "wall_id": seen.walls[number] + 1,
            "kind": part.kind,
            "seen_share": float(is_seen.mean()),
            "n_points": int(counts.sum()),
        }
        if part.layer == "openings":
            corners = [
                (x_0, y_0, part.low),
                (x_1, y_1, part.low),
                (x_1, y_1, part.high),
                (x_0, y_0, part.high),
            ]
            openings.append(_polygon((np.array(corners),), scene))
            size = {"width": part.length, "height": part.high - part.low, "depth": part.depth}
            opening_rows.append({**row, **size})
        else:
            ends = np.array([(x_0, y_0, part.low), (x_1, y_1, part.high)]) + scene.frame.origin
            eaves.append(shapely.LineString(ends))
            size = {"overhang": part.depth, "thickness": part.thickness, "length": part.length}
            eave_rows.append({**row, **size})
    return (
        VectorLayer("walls", lines, WALL_COLUMNS, rows, "LineString"),
        VectorLayer("openings", openings, OPENING_COLUMNS, opening_rows, "Polygon Z"),
        VectorLayer("eaves", eaves, EAVE_COLUMNS, eave_rows, "LineString Z"),
    )


def _obstacles(scene: VirtualScene) -> VectorLayer:
    zero = scene.frame.origin[2]
    rows = [
        {
            "kind": OBSTACLES[one.roof_type].name.lower(),
            "z_low": one.ground_elevation + zero,
            "z_high": one.roof_elevation_range[1] + zero,
        }
        for one in scene.obstacles
    ]
    polygons = [_polygon(one.outline.rings, scene) for one in scene.obstacles]
    return VectorLayer("obstacles", polygons, OBSTACLE_COLUMNS, rows)


def _polygon(rings: tuple[NDArray[np.float64], ...], scene: VirtualScene) -> shapely.Polygon:
    moved = [ring + np.asarray(scene.frame.origin)[: ring.shape[1]] for ring in rings]
    return shapely.Polygon(moved[0], moved[1:])
