"""Ordinary kriging: elevations between known places, and the variance of each."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.neighbours.sectors import N_SECTORS, sector_of

_Floats = NDArray[np.float64]

#: Vertices of each sector that take part, and how far they lie at most where there is any [m]; side of the
#: cells in which they are searched [m].
_OF_SECTOR, _REACH, _CELL = 2, 40.0, 2.0
#: Lags of the variogram [m]; the widest is about that of a large building.
_LAGS = np.geomspace(0.5, 40.0, 16)
#: Vertices from which pairs are taken, each in so many directions a lag, and the fewest pairs of a lag.
_SAMPLE, _DIRECTIONS, _MIN_PAIRS = 1000, 4, 30
#: The golden angle spreads directions evenly however many there are [rad].
_TURN = math.pi * (3.0 - math.sqrt(5.0))
#: Least nugget and sill [m²]: (1 mm)².
_LEAST = 1e-6
#: Places whose systems are solved at a time: a block takes some 20 MB.
_BLOCK = 4096

#: Name → the share of the sill that is reached at a distance, in ranges.
MODELS = {
    "spherical": lambda h: np.where(h < 1.0, 1.5 * h - 0.5 * h**3, 1.0),
    "exponential": lambda h: 1.0 - np.exp(-3.0 * h),
    "matern": lambda h: 1.0 - (1.0 + 4.75 * h) * np.exp(-4.75 * h),
}


class Variogram(NamedTuple):
    """How the semivariance of elevations grows with distance."""

    model: str  #: one of `MODELS`
    nugget: float  #: of places next to one another [m²]
    sill: float  #: by how much it grows beyond the nugget [m²]
    reach: float  #: where it has grown by 95 %, of ``spherical`` by all: the *range* [m]

    def __call__(self, distance: _Floats) -> _Floats:
        """Return the semivariance at distances [m], 0 at none [m²]."""
        grown = self.nugget + self.sill * MODELS[self.model](distance / self.reach)
        return np.where(distance > 0.0, grown, 0.0)


def fit_variogram(vertices: _Floats) -> Variogram:
    """
    Fit a variogram to points, shape (n, 3) [m], whatever their order.

    Semivariances are half the mean squares of differences of pairs (Matheron 1963), about as many at each
    lag. A model fits if it is off by a small part of itself, weighed by the pairs (Cressie 1985); the best of
    `MODELS` is taken. Too few points give a nugget alone.
    """
    from scipy.optimize import least_squares  # here, because kriging is no default

    lag, semivariance, n = _measured(vertices)
    if len(lag) < 4:
        return Variogram("spherical", _LEAST, _LEAST, _REACH)
    most = semivariance.max()
    start = np.log([max(semivariance[0] / 2.0, 2.0 * _LEAST), 2.0 * most, lag[-1]])
    bounds = np.log([[_LEAST, _LEAST, lag[0]], [2.0 * most, 100.0 * most, 10.0 * lag[-1]]])
    best = None
    for model in MODELS:

        def off(logs: _Floats, model: str = model) -> _Floats:
            return np.sqrt(n) * (semivariance / Variogram(model, *np.exp(logs))(lag) - 1.0)

        found = least_squares(off, np.clip(start, bounds[0], bounds[1]), bounds=bounds)
        if best is None or found.cost < best[0]:
            best = found.cost, Variogram(model, *np.exp(found.x).tolist())
    return best[1]  # type: ignore[index]


def _measured(vertices: _Floats) -> tuple[_Floats, _Floats, NDArray[np.int64]]:
    """Return the mean distance of the pairs of each lag [m], their semivariance [m²], and their number."""
    ordered = vertices[np.lexsort(vertices.T)]
    own = ordered[:: math.ceil(len(ordered) / _SAMPLE)]
    angle = _TURN * np.arange(len(own) * len(_LAGS) * _DIRECTIONS).reshape(len(own), -1)
    away = np.tile(_LAGS, _DIRECTIONS) * np.stack([np.cos(angle), np.sin(angle)])
    _, near = cKDTree(ordered[:, :2]).query(own[:, None, :2] + np.moveaxis(away, 0, -1))
    pairs = ordered[near] - own[:, None]
    distance, square = np.hypot(pairs[..., 0], pairs[..., 1]).ravel(), pairs[..., 2].ravel() ** 2 / 2.0
    edges = np.append(0.0, np.sqrt(_LAGS[1:] * _LAGS[:-1]))
    lag = np.searchsorted(edges, distance) - 1  # -1: a vertex with itself
    used = (lag >= 0) & (distance <= _LAGS[-1])
    n = np.bincount(lag[used], minlength=len(_LAGS))
    kept = n >= _MIN_PAIRS
    sums = (np.bincount(lag[used], one[used], len(_LAGS))[kept] / n[kept] for one in (distance, square))
    mean, semivariance = sums
    return mean, np.maximum(semivariance, _LEAST), n[kept]


def kriged(vertices: _Floats, variogram: Variogram, places: _Floats) -> tuple[_Floats, _Floats]:
    """
    Return elevations at places, shape (n_places, 2), and the variance of each [m], [m²].

    The two nearest vertices of each of eight sectors take part (at least one vertex; no two at one place):
    their weights, which sum up to 1, make the mean square error least (Matheron 1963; Isaaks and Srivastava
    1989). At a vertex its elevation stands, with the variance 0; what a nugget adds begins beside it.
    """
    # Sorted, so that which of equally near ones take part does not depend on their order.
    vertices = vertices[np.lexsort(vertices.T)]
    corner = vertices[:, :2].min(axis=0)
    column, row = np.floor((vertices[:, :2] - corner) / _CELL).astype(np.int64).T
    shape = int(row.max()) + 1, int(column.max()) + 1
    cell = row * shape[1] + column
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange(shape[0] * shape[1] + 1))
    known = np.ascontiguousarray(vertices[order])
    elevation, variance = np.empty((2, len(places)))
    for start in range(0, len(places), _BLOCK):
        some = np.ascontiguousarray(places[start : start + _BLOCK])
        near = _around(some - corner, known[:, :2] - corner, first, *shape)
        elevation[start : start + _BLOCK], variance[start : start + _BLOCK] = _solved(
            some, known[near], near >= 0, variogram
        )
    return elevation, variance


def _solved(
    places: _Floats, near: _Floats, is_there: NDArray[np.bool_], variogram: Variogram
) -> tuple[_Floats, _Floats]:
    """Solve the system of each place: semivariances between the vertices, and weights that sum up to 1."""
    n, k = is_there.shape
    apart = np.linalg.norm(near[:, :, None, :2] - near[:, None, :, :2], axis=-1)
    both = is_there[:, :, None] & is_there[:, None, :]
    system, right = np.zeros((n, k + 1, k + 1)), np.zeros((n, k + 1))
    system[:, :k, :k] = np.where(both, variogram(apart), 0.0)
    system[:, :k, k] = system[:, k, :k] = is_there
    # a vertex that is not there gets the weight 0
    system[:, np.arange(k), np.arange(k)] += ~is_there
    right[:, :k] = np.where(is_there, variogram(np.linalg.norm(near[..., :2] - places[:, None], axis=-1)), 0)
    right[:, k] = 1.0
    weight = np.linalg.solve(system, right[..., None])[..., 0]
    elevation = (weight[:, :k] * near[..., 2]).sum(axis=1)
    return elevation, np.maximum((weight * right).sum(axis=1), 0.0)


@kernel
def _around(places, vertices, first, n_rows, n_columns):  # type: ignore[no-untyped-def]
    """Return the vertices nearest to each place in each sector, −1 where there is none, (n, 16)."""
    near = np.full((len(places), N_SECTORS * _OF_SECTOR), -1, dtype=np.int64)
    away = np.empty(N_SECTORS * _OF_SECTOR)
    last = max(n_rows, n_columns)
    for i in range(len(places)):
        x, y = places[i, 0], places[i, 1]
        column, row = math.floor(x / _CELL), math.floor(y / _CELL)
        # rings that the raster of vertices does not reach are left out
        start = max(0, -column, -row, column - n_columns + 1, row - n_rows + 1)
        away[:] = np.inf
        for ring in range(start, start + last + 1):
            least = (ring - 1) * _CELL
            if least > 0.0 and least * least >= away.max():
                break
            if least > _REACH and away.min() < np.inf:
                break
            for r in range(max(row - ring, 0), min(row + ring + 1, n_rows)):
                step = 1 if abs(r - row) == ring or ring == 0 else 2 * ring
                for c in range(column - ring, column + ring + 1, step):
                    if not 0 <= c < n_columns:
                        continue
                    for v in range(first[r * n_columns + c], first[r * n_columns + c + 1]):
                        dx, dy = vertices[v, 0] - x, vertices[v, 1] - y
                        d = dx * dx + dy * dy
                        at = sector_of(dx, dy) * _OF_SECTOR
                        if d < away[at]:
                            away[at + 1], near[i, at + 1] = away[at], near[i, at]
                            away[at], near[i, at] = d, v
                        elif d < away[at + 1]:
                            away[at + 1], near[i, at + 1] = d, v
    return near
