"""
Roof scenes with exact truth: what tempts roof selection, one temptation a scene.

Each function takes `density` [pulses/m²], `noise` (σ along each axis) [m], `rotation_deg` (of the whole scene
about its middle) and `seed`, and returns a `RoofScene`. With their own densities none has more than 60 000
points. A building is what is higher than 2 m and larger than 12 m², with all that belongs to its roof.
"""

from __future__ import annotations

from collections.abc import Callable

from bench.scenes import roofs_green, roofs_shapes, roofs_town
from bench.scenes.kit import functions_of
from bench.scenes.roof_site import RoofScene

__all__ = ["ROOF_SCENES", "RoofScene"]

#: Name → function, every scene there is.
ROOF_SCENES: dict[str, Callable[..., RoofScene]] = functions_of(roofs_green, roofs_town, roofs_shapes)
