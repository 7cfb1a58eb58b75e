"""
One plane of a roof.

"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class RoofPlane:
    """
    One plane of a roof.

    Attributes
    ----------
    normal : ndarray of shape (3,)
        Unit normal, pointing upwards.
    centroid : ndarray of shape (3,)
        Mean of the plane's points, map frame [m].
    rms : float
        Root mean square of the points' orthogonal distances [m].
    n_points : int
        Number of points.

    """

    normal: NDArray[np.float64]
    centroid: NDArray[np.float64]
    rms: float
    n_points: int
