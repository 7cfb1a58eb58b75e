"""The plane that fits points best, by orthogonal distances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def least_squares_plane(
    points: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """
    Fit a plane by orthogonal least squares.

    Parameters
    ----------
    points : ndarray of shape (n_points, 3)
        At least one [m].

    Returns
    -------
    normal, centroid : ndarray of shape (3,)
        The unit normal points upwards.
    rms : float
        Root mean square of the orthogonal distances [m].
    """
    centroid = points.mean(axis=0)
    offsets = points - centroid
    normal = np.linalg.eigh(offsets.T @ offsets)[1][:, 0]
    if normal[2] < 0:
        normal = -normal
    return normal, centroid, float(np.sqrt(np.mean((offsets @ normal) ** 2)))
