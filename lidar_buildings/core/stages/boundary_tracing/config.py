"""Settings of the boundary tracing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lidar_buildings.core.model.parameters import StageConfig, advanced, parameter


@dataclass(frozen=True)
class BoundaryTracingConfig(StageConfig):
    """Settings of the boundary tracing."""

    stage: ClassVar[str] = "boundary_tracing"

    method: str = advanced(
        "walk",
        "How the ring is found: by a walk from neighbour to neighbour (Sampath & Shan, 2007), or as an alpha "
        "shape with a radius by the local spacing (dos Santos, Galo & Carrilho, 2019), which asks no ground.",
        choices=("walk", "alpha_shape"),
    )
    alpha: float = advanced(
        1.5,
        "Radius of the alpha shape; raising it smooths the ring and closes wider gaps.",
        unit="spacings",
        within=(0.5, 20.0),
    )
    source: str = advanced(
        "points",
        "Which points of a building are traced: all, or those labelled as edges, as Santos and others "
        "suggest.",
        choices=("points", "edge_points"),
    )
    neighbourhood: str = advanced(
        "automatic",
        "Shape of the neighbourhood: a rectangle where scan lines tell how it should be turned, else a disc; "
        "or, as published, always a rectangle, with the scan's own spacings however they differ.",
        choices=("automatic", "rectangle"),
    )
    window: float = parameter(
        6.0,
        "Sides of the neighbourhood of each step; raising it smooths the ring and closes narrow gaps.",
        unit="spacings",
        within=(2.0, 40.0),
    )
    courtyards: bool = advanced(
        True, "Whether courtyards are traced as holes, and ground that was seen is left out."
    )
    min_courtyard_area: float = parameter(
        9.0,
        "Smallest area of a courtyard; raising it leaves more gaps inside the roof unmarked.",
        unit="m²",
        within=(0.0, None),
    )


#: The walk of Sampath & Shan (2007): a window slightly larger than twice the spacing, and no courtyards.
AS_PUBLISHED = BoundaryTracingConfig(window=2.2, neighbourhood="rectangle", courtyards=False)
