"""One face of a roof as it is seen in plan: its rings and the plane it lies in."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_buildings.core.model.array_types import FloatArray


@dataclass(frozen=True, eq=False)
class RoofPiece:
    """A part of a building's plan that one plane covers."""

    #: Open; the exterior counter-clockwise, then the holes clockwise, map frame [m], shape (n_vertices, 2).
    rings: tuple[FloatArray, ...]
    plane: tuple[float, float, float]  #: (a, b, c) of the elevation a x + b y + c, map frame [m]

    def elevation(self, x: float, y: float) -> float:
        """Return the elevation of the plane at a place [m]."""
        a, b, c = self.plane
        return a * x + b * y + c
