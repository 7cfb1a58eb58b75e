"""What is true of a scene: a GeoPackage of `outlines` and `roof_faces`, and CityJSONSeq 2.0."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.io.files.atomic_files import compact_json
from lidar_buildings.io.vectors.layers import VectorLayer, geopackage_file
from lidar_buildings.simulation.building import Building, shell_of
from lidar_buildings.simulation.flight import SURVEY_DATE
from lidar_buildings.simulation.scene import VirtualScene

#: Columns of layer `outlines`, and of layer `roof_faces`.
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


def write_truth_layers(path: Path, scene: VirtualScene) -> None:
    """Write the roofprints with their attributes, and the roof faces in 3D."""
    outlines = [_polygon(b.outline.rings, scene) for b in scene.buildings]
    faces = [_polygon(face.rings_3d, scene) for b in scene.buildings for face in b.faces]
    with geopackage_file(path, scene.frame.crs) as add:
        add(VectorLayer("outlines", outlines, OUTLINE_COLUMNS, building_attributes(scene)))
        add(VectorLayer("roof_faces", faces, FACE_COLUMNS, _face_rows(scene), "Polygon Z"))


def _face_rows(scene: VirtualScene) -> list[dict[str, Any]]:
    """Number, slope and true (inclined) area [m²] of every face."""
    return [
        {
            "building_number": building.number,
            "plane_id": plane_id,
            "slope_deg": float(np.rad2deg(np.arccos(face.normal[2]))),
            "area": float(face.polygon.area / face.normal[2]),
        }
        for building in scene.buildings
        for plane_id, face in enumerate(building.faces, start=1)
    ]


def _polygon(rings: tuple[NDArray[np.float64], ...], scene: VirtualScene) -> shapely.Polygon:
    moved = [ring + np.asarray(scene.frame.origin)[: ring.shape[1]] for ring in rings]
    return shapely.Polygon(moved[0], moved[1:])


#: Coordinates are whole multiples of this [m].
SCALE = 0.001


def write_truth_city_model(path: Path, scene: VirtualScene) -> None:
    """Write the header and one feature per building, one JSON text per line."""
    texts = [_header(scene), *map(_feature, scene.buildings, building_attributes(scene))]
    path.write_text("".join(f"{compact_json(one)}\n" for one in texts), encoding="utf-8")


def _header(scene: VirtualScene) -> dict[str, Any]:
    authority, code = scene.frame.crs.split(":")
    return {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [SCALE] * 3, "translate": list(scene.frame.origin)},
        "metadata": {
            "referenceSystem": f"https://www.opengis.net/def/crs/{authority}/0/{code}",
            "referenceDate": SURVEY_DATE.isoformat(),
            "title": f"True buildings of the virtual scene {scene.name}",
        },
        "CityObjects": {},
        "vertices": [],
    }


def _feature(building: Building, attributes: dict[str, Any]) -> dict[str, Any]:
    name = f"building-{building.number}"
    shell = shell_of(building)
    vertices: dict[tuple[int, ...], int] = {}
    boundary = [[_ring(ring, vertices) for ring in surface] for surface in shell.surfaces]
    kinds = [0] * len(shell.roofs) + [1] * len(shell.walls) + [2]
    solid = {
        "type": "Solid",
        "lod": "2.2",
        "boundaries": [boundary],
        "semantics": {
            "surfaces": [{"type": "RoofSurface"}, {"type": "WallSurface"}, {"type": "GroundSurface"}],
            "values": [kinds],
        },
    }
    rounded = {
        key: round(value, 4) if isinstance(value, float) else value for key, value in attributes.items()
    }
    return {
        "type": "CityJSONFeature",
        "id": name,
        "CityObjects": {name: {"type": "Building", "attributes": rounded, "geometry": [solid]}},
        "vertices": [list(vertex) for vertex in vertices],
    }


def _ring(ring: NDArray[np.float64], vertices: dict[tuple[int, ...], int]) -> list[int]:
    """Numbers of a ring's vertices, new ones appended."""
    rounded = [tuple(int(c) for c in row) for row in np.round(ring / SCALE)]
    return [vertices.setdefault(vertex, len(vertices)) for vertex in rounded]
