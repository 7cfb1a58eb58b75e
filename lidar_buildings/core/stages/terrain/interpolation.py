"""Elevations of the ground between the places where it is known, by one of five methods."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from importlib import import_module

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.stages.terrain.kriging import fit_variogram, kriged
from lidar_buildings.core.surfaces.triangulation import triangulate

_log = logging.getLogger(__name__)

LINEAR, NATURAL, IDW, SPLINE, KRIGING = METHODS = ("linear", "natural_neighbour", "idw", "spline", "kriging")
#: So many of the nearest vertices take part in `idw` and `spline`.
_N_NEAREST = 16
#: Vertices weigh by this power of their inverse distance, which is at least a millimetre.
_POWER, _LEAST = 2.0, 1e-3


#: Gives the elevations at places, shape (n, 2) → (n,) [m].
Interpolator = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def interpolator(
    vertices: NDArray[np.float64], extent: NDArray[np.float64], method: str = LINEAR
) -> Interpolator:
    """
    Return what gives elevations at places, shape (n_places, 2) [m].

    - ``linear``: in the triangles of the TIN, beyond it that of the nearest vertex.
    - ``natural_neighbour``: Sibson (1981), by startinpy; linear beyond the TIN.
    - ``idw``: mean of the nearest vertices by the inverse square of their distance (Shepard 1968).
    - ``spline``: thin-plate spline of the nearest vertices (Duchon 1977), by SciPy; the same as kriging with
      the generalised covariance r² log r and a plane as drift.
    - ``kriging``: ordinary kriging by a variogram fitted to the vertices, see `kriging`.

    - `vertices`, shape (n_vertices, 3): At least one, no two at one place [m].
    - `extent`, shape (2, 2): Least and greatest x and y of the places [m]; linear is fastest where
      consecutive ones are near.
    - `method`: One of `METHODS`.
    """
    if method == IDW:
        return partial(_by_distance, vertices, cKDTree(vertices[:, :2]))
    if method == KRIGING:
        variogram = fit_variogram(vertices)
        return lambda places: kriged(vertices, variogram, places)[0]
    linear = triangulate(vertices, extent).elevation
    if method == NATURAL:
        return _by_natural_neighbours(vertices, linear)
    return partial(_by_spline, vertices, linear) if method == SPLINE else linear


def _by_distance(
    vertices: NDArray[np.float64], tree: cKDTree, places: NDArray[np.float64]
) -> NDArray[np.float64]:
    n = min(_N_NEAREST, len(vertices))
    distance, near = (one.reshape(-1, n) for one in tree.query(places, n))
    weight = np.maximum(distance, _LEAST) ** -_POWER
    return np.asarray((weight * vertices[near, 2]).sum(axis=1) / weight.sum(axis=1))


def _by_natural_neighbours(vertices: NDArray[np.float64], linear: Interpolator) -> Interpolator:
    tin = import_module("startinpy").DT()  # of the extra `terrain`
    origin = np.floor(vertices.min(axis=0))
    tin.insert(vertices - origin, insertionstrategy="AsIs")

    def elevations(places: NDArray[np.float64]) -> NDArray[np.float64]:
        found = tin.interpolate({"method": "NNI", "precompute": False}, places - origin[:2]) + origin[2]
        return np.where(np.isnan(found), linear(places), found)

    return elevations


def _by_spline(
    vertices: NDArray[np.float64], linear: Interpolator, places: NDArray[np.float64]
) -> NDArray[np.float64]:
    from scipy.interpolate import RBFInterpolator  # here, because it takes 0.1 s and is no default

    try:
        n = min(_N_NEAREST, len(vertices))
        found = RBFInterpolator(vertices[:, :2], vertices[:, 2], n, kernel="thin_plate_spline")(places)
    except (np.linalg.LinAlgError, ValueError):
        _log.warning("spline: the nearest points of a place are too few or on a line: linear instead")
        return linear(places)
    return np.asarray(found)
