"""A raster of elevations as an organised cloud: rows and columns of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2

from lidar_buildings.core.stages.terrain import RasterWindow
from lidar_buildings.ros.point_cloud import cloud_message

_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])


def grid_message(stamp: int, window: RasterWindow, elevation: NDArray[np.float32]) -> PointCloud2:
    """
    Put a raster into a cloud of as many rows and columns, the northernmost row first.

    Every cell has its middle as x and y; z is NaN where the elevation is not known.

    Parameters
    ----------
    stamp : int
        The tile's key [ns].
    window : RasterWindow
        Where the cells lie in the map frame.
    elevation : ndarray of shape (height, width)
        In the map frame [m].
    """
    rows = np.empty(window.shape, dtype=_POINT)
    centres = window.centres(*np.indices(window.shape), (0.0, 0.0))
    rows["x"], rows["y"], rows["z"] = centres[..., 0], centres[..., 1], elevation
    return cloud_message(stamp, rows, is_dense=False)
