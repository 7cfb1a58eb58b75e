"""
The eight theoretical shapes of Gross and Thoennessen (2006), by which discriminant analysis tells edges.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Shape(NamedTuple):
    """What a sphere of radius 1 about a point cuts out of an ideal structure."""

    name: str  #: in the words of the paper
    eigenvalues: tuple[float, float, float]  #: λ1 ≥ λ2 ≥ λ3 of the covariance about the mean, in units of R²
    is_edge: bool  #: the group that Santos and others put it in


# Moments over discs and sectors of radius 1: a half disc's centre lies 4/3π off, a quarter's on both axes.
_OFF = 4.0 / (3.0 * math.pi)
# A quarter disc's covariance has this diagonal and this beside it.
_QUARTER, _BESIDE = 1 / 4 - _OFF**2, 1 / (2 * math.pi) - _OFF**2
# The same of three quarter discs, one in each plane of coordinates.
_CORNER, _BESIDE_CORNER = 1 / 6 - (2 * _OFF / 3) ** 2, 1 / (6 * math.pi) - (2 * _OFF / 3) ** 2

#: The eight shapes. Of two planes at a right angle each is a half disc off the other by its own 4/3π.
SHAPES = (
    Shape("isolated point", (0.0, 0.0, 0.0), False),
    Shape("end of a line", (1 / 12, 0.0, 0.0), False),
    Shape("line", (1 / 3, 0.0, 0.0), True),
    Shape("half plane", (1 / 4, 1 / 4 - _OFF**2, 0.0), True),
    Shape("quarter plane", (_QUARTER - _BESIDE, _QUARTER + _BESIDE, 0.0), True),
    Shape("plane", (1 / 4, 1 / 4, 0.0), False),
    Shape("two planes", (1 / 4, 1 / 8, 1 / 8 - _OFF**2 / 2), True),
    Shape(
        "three planes",
        (_CORNER - _BESIDE_CORNER, _CORNER - _BESIDE_CORNER, _CORNER + 2 * _BESIDE_CORNER),
        False,
    ),
)


def nearest_shapes(eigenvalues: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the row in `SHAPES` nearest to each λ1 ≥ λ2 ≥ λ3, in units of R²; of two as near the first."""
    from sklearn.metrics import pairwise_distances_argmin  # here, because it takes 0.7 s

    if len(eigenvalues) == 0:
        return np.zeros(0, dtype=np.int64)
    shapes = np.array([shape.eigenvalues for shape in SHAPES])
    # Minkowski's is Euclid's at its default p = 2, but not by products of matrices, whose rounding could
    # depend on the order of the points.
    return pairwise_distances_argmin(eigenvalues, shapes, metric="minkowski")


def discriminant_edges(eigenvalues: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points' nearest shape is an edge: line, half plane, quarter plane or two planes."""
    return np.array([shape.is_edge for shape in SHAPES])[nearest_shapes(eigenvalues)]
