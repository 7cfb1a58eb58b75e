"""A face of a roof before it becomes part of a solid."""

from __future__ import annotations

from dataclasses import dataclass

from lidar_buildings.core.model.array_types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class RoofFacePatch:
    """
    A roof face: a polygon in plan with one plane, and its points.

    Attributes
    ----------
    rings : tuple of ndarray of shape (n_vertices, 2)
        Outer ring counter-clockwise, then holes clockwise, open [m].
    plane : ndarray of shape (3,)
        z = a·x + b·y + c.
    rows : ndarray of shape (n_points,), int64
        Rows of the building's points over the face.
    part : int
        Number of the part of the roof that has one height in LoD1.3.
    """

    rings: tuple[FloatArray, ...]
    plane: FloatArray
    rows: IntArray
    part: int = 0
