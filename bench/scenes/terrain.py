"""
Terrain scenes with exact truth: what tempts a ground filter, one temptation a scene.

Each function takes `density` [pts/m²], `noise` (σ along z) [m], `rotation_deg` (of the whole scene about its
middle) and `seed`, and returns a `TerrainScene`: `points` of shape (n, 3) and `is_ground`. With their own
densities none has more than 60 000 points. Returns are in rows along the scene's x.
"""

from __future__ import annotations

from collections.abc import Callable

from bench.scenes.terrain_built import (
    bridge_over_cut,
    city_block,
    dense_street,
    garage_ramp,
    hall_in_hillside,
    houses_on_hillside,
    large_hall,
    low_walls_and_hedges,
    motorway_embankment,
    overpass_with_ramps,
    sparse_suburb,
)
from bench.scenes.terrain_open import (
    dyke_and_mound,
    lake_gap,
    low_outliers,
    mountain_ridge,
    quarry,
    river_bank,
    steep_forest,
    strip_edges,
    terraced_vineyard,
)
from bench.scenes.terrain_site import TerrainScene

__all__ = ["TERRAIN_SCENES", "TerrainScene"]

#: Name → function, every scene there is.
TERRAIN_SCENES: dict[str, Callable[..., TerrainScene]] = {
    scene.__name__: scene
    for scene in (
        large_hall,
        hall_in_hillside,
        city_block,
        bridge_over_cut,
        overpass_with_ramps,
        motorway_embankment,
        low_walls_and_hedges,
        garage_ramp,
        houses_on_hillside,
        sparse_suburb,
        dense_street,
        quarry,
        river_bank,
        steep_forest,
        terraced_vineyard,
        lake_gap,
        strip_edges,
        low_outliers,
        dyke_and_mound,
        mountain_ridge,
    )
}
