"""
What is true of a scene: each building in words and numbers, and as GeoPackage of `outlines` and `roof_faces`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

from lidar_buildings.simulation.building import Building
from lidar_buildings.simulation.flight import SURVEY_DATE
from lidar_buildings.simulation.scene import VirtualScene

#: Column → dtype of layer `outlines`.
OUTLINE_COLUMNS: dict[str, Any] = {
    "building_number": np.int32,
    "block_number": np.int32,
    "roof_type": object,
    "ground_elevation": np.float64,
    "roof_elevation_min": np.float64,
    "roof_elevation_max": np.float64,
    "height": np.float64,
    "area": np.float64,
    "n_planes": np.int32,
}
#: Column → dtype of layer `roof_faces`.
FACE_COLUMNS: dict[str, Any] = {
    "building_number": np.int32,
    "plane_id": np.int32,
    "slope_deg": np.float64,
    "area": np.float64,
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
    # The file's own date would make two equal runs differ.
    pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": f"{SURVEY_DATE.isoformat()}T00:00:00.000Z"})
    try:
        outlines = [_polygon(b.outline.rings, scene) for b in scene.buildings]
        _write_layer(
            path, scene, "outlines", "Polygon", outlines, building_attributes(scene), OUTLINE_COLUMNS
        )
        faces = [_polygon(face.rings_3d, scene) for b in scene.buildings for face in b.faces]
        _write_layer(path, scene, "roof_faces", "Polygon Z", faces, _face_rows(scene), FACE_COLUMNS)
    finally:
        pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": None})


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


def _write_layer(
    path: Path,
    scene: VirtualScene,
    layer: str,
    geometry_type: str,
    polygons: list[shapely.Polygon],
    rows: list[dict[str, Any]],
    columns: dict[str, Any],
) -> None:
    pyogrio.raw.write(
        path,
        np.array([shapely.to_wkb(polygon) for polygon in polygons], dtype=object),
        [np.array([row[name] for row in rows], dtype=dtype) for name, dtype in columns.items()],
        np.array(list(columns)),
        layer=layer,
        driver="GPKG",
        geometry_type=geometry_type,
        crs=scene.frame.crs,
    )
