"""One face of a roof as it is seen in plan: its rings and the plane it lies in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lidar_buildings.core.model.array_types import FloatArray


@dataclass(frozen=True, eq=False)
class RoofPiece:
    """
    A part of a building's plan that one plane covers.

    Attributes
    ----------
    rings : tuple of ndarray of shape (n_vertices, 2)
        Open; the exterior counter-clockwise, then the holes clockwise, map frame [m].
    plane : tuple of float
        (a, b, c) of the elevation a x + b y + c, map frame [m].
    """

    rings: tuple[FloatArray, ...]
    plane: tuple[float, float, float]

    def elevation(self, x: float, y: float) -> float:
        """Return the elevation of the plane at a place [m]."""
        a, b, c = self.plane
        return a * x + b * y + c


def check_pieces(pieces: Sequence[RoofPiece]) -> None:
    """
    Refuse pieces that are not what `RoofPiece` says.

    Raises
    ------
    ValueError
        If a plane is not three finite numbers, or a ring not an array of shape (n, 2) of finite numbers.
    """
    for number, piece in enumerate(pieces):
        if len(piece.plane) != 3 or not all(map(math.isfinite, piece.plane)):
            raise ValueError(f"pieces[{number}].plane = {piece.plane}: must be three finite numbers")
        for ring in piece.rings:
            if ring.ndim != 2 or ring.shape[1] != 2:
                raise ValueError(f"pieces[{number}].rings: shape {ring.shape} must be (n_vertices, 2)")
    rings = [ring for piece in pieces for ring in piece.rings]
    if rings and not np.isfinite(np.concatenate(rings)).all():
        bad = (
            k for k, piece in enumerate(pieces) if not all(np.isfinite(ring).all() for ring in piece.rings)
        )
        raise ValueError(f"pieces[{next(bad)}].rings: must be finite")
