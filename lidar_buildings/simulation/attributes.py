"""What is known of each building of a scene, named as in the results."""

from __future__ import annotations

from typing import Any

from lidar_buildings.simulation.building import Building
from lidar_buildings.simulation.scene import VirtualScene


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
