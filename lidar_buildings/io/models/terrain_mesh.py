"""A piece of the terrain, as the formats of city models are given it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class TerrainMesh:
    """
    The ground of one square as triangles; neighbouring squares share the vertices between them.

    Attributes
    ----------
    name : str
        Made from the coordinates of its north-western corner.
    vertices : ndarray of shape (n_vertices, 3)
        Map frame, whole millimetres [m].
    triangles : ndarray of shape (n_triangles, 3)
        Rows of the vertices, counter-clockwise from above.
    """

    name: str
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]
