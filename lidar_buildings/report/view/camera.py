"""Where a camera stands that sees all that is drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.report.view import ABOVE, SIDES

#: Where the eye is → its direction clockwise from north, and above the horizon [deg].
_EYES = {side: (45.0 * k, 35.0) for k, side in enumerate(SIDES)} | {ABOVE: (180.0, 89.9)}
#: Height of the cone of view, and the share of it that is filled.
_FIELD_OF_VIEW_DEG, _FILLED = 30.0, 0.98


def camera_of(places: NDArray[np.float64], eye: str, size: tuple[int, int]) -> tuple[float, NDArray[Any]]:
    """
    Put a camera as near as it sees all places.

    Parameters
    ----------
    places : ndarray of shape (n, 3)
        Map frame [m].
    eye : str
        One of `SIDES`, or `ABOVE`.
    size : tuple of two int
        Width and height of the picture [pixels].

    Returns
    -------
    focal : float
        Focal length [pixels].
    extrinsic : ndarray of shape (4, 4)
        Map frame → right, down and ahead of the camera.
    """
    azimuth, tilt = np.deg2rad(_EYES[eye])
    to_eye = np.array([np.sin(azimuth) * np.cos(tilt), np.cos(azimuth) * np.cos(tilt), np.sin(tilt)])
    right = np.array([-np.cos(azimuth), np.sin(azimuth), 0.0])
    axes = np.stack([right, np.cross(right, to_eye), -to_eye])
    turned = places @ axes.T
    focal = size[1] / 2 / np.tan(np.deg2rad(_FIELD_OF_VIEW_DEG) / 2)
    slopes = np.array(size) / 2 / focal * _FILLED
    # each of the four sides of the cone touches one place; the narrower pair says how far back it begins
    high, low = ((sign * turned[:, :2] - slopes * turned[:, 2:]).max(axis=0) for sign in (1, -1))
    camera = np.append((high - low) / 2, -((high + low) / 2 / slopes).max())
    return focal, np.block([[axes, -camera[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
