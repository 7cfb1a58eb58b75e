"""
Roof scenes with exact truth: what tempts roof selection, one temptation a scene.

Each function takes `density` [pulses/m²], `noise` (σ along each axis) [m], `rotation_deg` (of the whole scene
about its middle) and `seed`, and returns a `RoofScene`. With their own densities none has more than 60 000
points. A building is what is higher than 2 m and larger than 12 m², with all that belongs to its roof.
"""

from __future__ import annotations

from collections.abc import Callable

from bench.scenes.roof_site import RoofScene
from bench.scenes.roofs_green import (
    forest_edge,
    hedges_and_walls,
    hillside,
    roof_gardens,
    sparse_suburb,
    trees_over_roofs,
    without_returns,
)
from bench.scenes.roofs_shapes import (
    courtyards,
    curved_roofs,
    dormers_and_chimneys,
    industrial_hall,
    parapet_roofs,
    row_houses,
    steep_roofs,
    step_roofs,
    towers,
)
from bench.scenes.roofs_town import (
    bridges,
    cranes_and_masts,
    dense_block,
    facades,
    garages_sheds_awnings,
    glass,
    vehicles,
)

__all__ = ["ROOF_SCENES", "RoofScene"]

#: Name → function, every scene there is.
ROOF_SCENES: dict[str, Callable[..., RoofScene]] = {
    scene.__name__: scene
    for scene in (
        trees_over_roofs,
        without_returns,
        forest_edge,
        roof_gardens,
        hedges_and_walls,
        vehicles,
        garages_sheds_awnings,
        bridges,
        facades,
        glass,
        cranes_and_masts,
        dormers_and_chimneys,
        steep_roofs,
        curved_roofs,
        towers,
        parapet_roofs,
        courtyards,
        step_roofs,
        row_houses,
        industrial_hall,
        hillside,
        sparse_suburb,
        dense_block,
    )
}
