"""
Terrain scenes with exact truth: what tempts a ground filter, one temptation a scene.

Each function takes `density` [pts/m²], `noise` (σ along z) [m], `rotation_deg` (of the whole scene about its
middle) and `seed`, and returns a `TerrainScene`: `points` of shape (n, 3) and `is_ground`. With their own
densities none has more than 60 000 points. Returns are in rows along the scene's x.
"""

from __future__ import annotations

from collections.abc import Callable

from bench.scenes import terrain_built, terrain_open
from bench.scenes.kit import functions_of
from bench.scenes.terrain_site import TerrainScene

__all__ = ["TERRAIN_SCENES", "TerrainScene"]

#: Name → function, every scene there is.
TERRAIN_SCENES: dict[str, Callable[..., TerrainScene]] = functions_of(terrain_built, terrain_open)
