"""What a method looks for roofs among, the same for all methods."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Smallest radius of a neighbourhood, in spacings: sixteen points on an even surface, where planes take six.
RADIUS_SPACINGS = 2.25
#: The same where the cloud is dense: the scale at which foliage is no longer flat [m].
MIN_RADIUS = 0.75
#: Steepest roof: between mansards and walls [deg].
MAX_SLOPE_DEG = 75.0
#: Largest angle between the normals of neighbours on one roof: smooth at `max_roughness`, and no ridge [deg].
MAX_ANGLE_DEG = 15.0


class Candidates(NamedTuple):
    """
    The points that rise above ground, and what a method may want to know of them.

    A method returns which of them are roof, of any size: small buildings are dropped by the caller.

    Attributes
    ----------
    points : ndarray of shape (n_points, 3)
        From half of `min_height` on, in any order [m].
    height : ndarray of shape (n_points,)
        Above ground [m].
    is_last, is_only : ndarray of bool, shape (n_points,)
        Whether the pulse ended there, and whether that is all that came back of it.
    ground : ndarray of shape (n_ground, 3)
        Ground and what is lower than the candidates [m].
    radius : float
        Smallest radius of a neighbourhood, and longest step within a surface [m].
    cell : float
        Side of the cells in which areas are counted, two spacings [m].
    """

    points: NDArray[np.float64]
    height: NDArray[np.float64]
    is_last: NDArray[np.bool_]
    is_only: NDArray[np.bool_]
    ground: NDArray[np.float64]
    radius: float
    cell: float
