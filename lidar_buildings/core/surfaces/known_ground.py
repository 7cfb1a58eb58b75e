"""Elevations of the ground about a building, from the places under its roof at which they are known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.neighbours.cell_grid import lowest_per_cell

#: Of each cell one place is kept; of such cells the ground filter makes its TIN [m].
_CELL = 1.0
#: So many of the nearest places tell the ground at a place.
_N_NEAREST = 24
#: What lies so far above the others counts half: bases of walls and bushes pass for ground, nothing below it
#: does [m].
_RAISED = 0.05
#: Rounds in which it is told what lies above the others.
_N_ROUNDS = 3
#: From this distance on places count half or less [m].
_NEAR = 1.0
#: Places on a line do not tell how the ground slopes across it: this variance keeps it to the plane [m²].
_SPREAD = 0.3


@dataclass(frozen=True, eq=False)
class KnownGround:
    """
    Places at which the ground's elevation is known, and the plane that it keeps to on the whole.

    Outlines reach beyond the points of roofs, so a plane through what lies near is fitted anew at each place:
    by its distance (Cleveland 1979), and above it by much less.
    """

    places: FloatArray  #: map frame [m], shape (n_places, 3)
    plane: FloatArray  #: a, b, c of z = a·x + b·y + c [m/m], [m], shape (3,)

    @classmethod
    def at(cls, places: ArrayLike) -> KnownGround:
        """Take one of the places, shape (n_places, 3), of each square metre; ValueError if there is none."""
        places = checked_points(places)
        if not len(places):
            raise ValueError("places is empty: the ground has to be known somewhere")
        places = places[lowest_per_cell(places, _CELL)]
        centre = places.mean(axis=0)
        slope = np.linalg.lstsq(places[:, :2] - centre[:2], places[:, 2] - centre[2], rcond=None)[0]
        return cls(places, np.append(slope, centre[2] - slope @ centre[:2]))

    def within(self, low: FloatArray, high: FloatArray) -> KnownGround:
        """Return what is known within a rectangle, with the same plane; all if that is too little."""
        inside = ((self.places[:, :2] >= low) & (self.places[:, :2] <= high)).all(axis=1)
        return replace(self, places=self.places[inside]) if inside.sum() >= _N_NEAREST else self

    def elevation(self, plan: FloatArray) -> FloatArray:
        """Return the ground's elevation at places, shape (n, 2) → (n,) [m]."""
        n = min(_N_NEAREST, len(self.places))
        near = cKDTree(self.places[:, :2]).query(plan, n)[1].reshape(-1, n)
        off = np.column_stack([self.places[:, :2], self.places[:, 2] - self._on_plane(self.places)])
        return np.asarray(self._on_plane(plan) + _fitted(plan, off, near))

    def _on_plane(self, plan: FloatArray) -> FloatArray:
        a, b, c = self.plane.tolist()
        return np.asarray(a * plan[:, 0] + b * plan[:, 1] + c)


@kernel
def _fitted(plan, known, near):  # type: ignore[no-untyped-def]
    """Return the elevation at each place of the plane through those near it, of which many lie on it."""
    result, n = np.empty(len(plan)), near.shape[1]
    for i in range(len(plan)):
        a, b, z = 0.0, 0.0, np.inf
        for _ in range(_N_ROUNDS + 1):
            total, x, y, up, xx, xy, yy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for k in near[i]:
                u, v, w = known[k, 0] - plan[i, 0], known[k, 1] - plan[i, 1], known[k, 2]
                above = max(w - (a * u + b * v + z), 0.0) / _RAISED
                weight = 1.0 / ((1.0 + (u * u + v * v) / _NEAR**2) * (1.0 + above * above))
                total, x, y, up = total + weight, x + weight * u, y + weight * v, up + weight * w
                xx, xy, yy = xx + weight * u * u, xy + weight * u * v, yy + weight * v * v
                xz, yz = xz + weight * u * w, yz + weight * v * w
            x, y, up = x / total, y / total, up / total
            # about the middle
            ridge = _SPREAD * total / n
            xx, yy, xy = xx - total * x * x + ridge, yy - total * y * y + ridge, xy - total * x * y
            xz, yz = xz - total * x * up, yz - total * y * up
            size = xx * yy - xy * xy
            a, b = (xz * yy - yz * xy) / size, (yz * xx - xz * xy) / size
            z = up - a * x - b * y
        result[i] = z
    return result
