"""
What is true of a scene: each building in words and numbers, and as GeoPackage of `outlines` and `roof_faces`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.io.vectors.geopackage import VectorLayer, geopackage_file
from lidar_buildings.simulation.building import Building
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
FACE_COLUMNS: dict[str, type] = {
    "building_number": int,
    "plane_id": int,
    "slope_deg": float,
    "area": float,
}


def building_attributes(scene: VirtualScene) -> list[dict[str, Any]]:
    """Return one row per building; elevations in the source's reference system [m]."""
    if not scene.buildings:
        return []
    return [
        _attributes(b, int(block), scene.frame.origin[2])
        for b, block in zip(scene.buildings, scene.blocks(), strict=True)
    ]


def _attributes(building: Building, block: int, zero: float) -> dict[str, Any]:
    """Attributes of one building; touching buildings have the same block number."""
    low, high = building.roof_elevation_range
    return {
        "building_number": building.number,
        "block_number": block,
        "roof_type": building.roof_type,
        "ground_elevation": building.ground_elevation + zero,
        "roof_elevation_min": low + zero,
        "roof_elevation_max": high + zero,
        "height": building.height,
        "area": building.outline.area,
        "n_planes": len(building.faces),
    }


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
