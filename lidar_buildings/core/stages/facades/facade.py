"""What is found of a façade."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Kinds of façades: on a straight line, or on an arc of a circle.
STRAIGHT, ARC = "straight", "arc"
#: Building of a façade of which none is known.
NO_BUILDING = -1


@dataclass(frozen=True, eq=False)
class Facade:
    """A wall as it was seen from the street; its front is on the left of its foot line."""

    foot: NDArray[np.float64]  #: line in plan on which it stands, map frame [m], shape (n_vertices ≥ 2, 2)
    bottom: float  #: elevations between which it was seen [m]
    top: float
    #: Which steps of the foot line were seen, evenly from its first vertex to the last, about
    #: `lidar_buildings.core.stages.facades.walls.BIN` long each.
    is_seen: NDArray[np.bool_]
    coverage: float  #: share of the rectangle above the foot line, from bottom to top, that was seen
    sigma: float  #: of the points on it about the wall [m]
    n_points: int  #: on it
    confidence: float  #: 0 to 1 that it is of a building
    kind: str  #: `STRAIGHT` or `ARC`
    building_id: int = NO_BUILDING  #: see `lidar_buildings.core.model.ids`

    @property
    def length(self) -> float:
        """Length of the foot line [m]."""
        return float(np.hypot(*np.diff(self.foot, axis=0).T).sum())

    @property
    def seen_share(self) -> float:
        """Share of the foot line that was seen."""
        return float(self.is_seen.mean())
