"""
Shape of every point's neighbourhood, from the eigenvalues of its covariance.

"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.neighbourhoods import build_grid, z_range
from lidar_buildings.core.row_blocks import for_row_blocks
from lidar_buildings.core.symmetric_eigen import eigenvalues_3x3, smallest_eigenvector_3x3

#: Points looked at around one point; where there are more, every second, third… by elevation of each column
#: is taken. The nine columns hold three times as many points as the disc of the largest radius.
MAX_CANDIDATES = 4608
#: Bins of the squared distance by which shells are looked up.
LOOKUP_BINS = 256


@dataclass(frozen=True, eq=False)
class EigenFeatures:
    """
    What principal component analysis says of each point's neighbourhood.

    Attributes
    ----------
    eigenvalues : ndarray of shape (n_points, 3)
        λ1 ≥ λ2 ≥ λ3 ≥ 0 of the covariance about the mean [m²].
    normals : ndarray of shape (n_points, 3)
        Unit direction of λ3, z ≥ 0; the most upward one where it is not unique.
    radius : ndarray of shape (n_points,)
        Radius of the neighbourhood [m].
    n_neighbours : ndarray of int64, shape (n_points,)
        Points within the radius, the point itself included.

    """

    eigenvalues: NDArray[np.float64]
    normals: NDArray[np.float64]
    radius: NDArray[np.float64]
    n_neighbours: NDArray[np.int64]

    @property
    def linearity(self) -> NDArray[np.float64]:
        """
        (λ1 − λ2)/λ1, 0 where all neighbours coincide.

        """
        return _ratio(self.eigenvalues[:, 0] - self.eigenvalues[:, 1], self.eigenvalues[:, 0])

    @property
    def planarity(self) -> NDArray[np.float64]:
        """
        (λ2 − λ3)/λ1, 0 where all neighbours coincide.

        """
        return _ratio(self.eigenvalues[:, 1] - self.eigenvalues[:, 2], self.eigenvalues[:, 0])

    @property
    def scattering(self) -> NDArray[np.float64]:
        """
        λ3/λ1, 0 where all neighbours coincide.

        """
        return _ratio(self.eigenvalues[:, 2], self.eigenvalues[:, 0])

    @property
    def surface_variation(self) -> NDArray[np.float64]:
        """
        λ3/(λ1 + λ2 + λ3), Pauly and others (2002).

        """
        return _ratio(self.eigenvalues[:, 2], self.eigenvalues.sum(axis=1))

    @property
    def roughness(self) -> NDArray[np.float64]:
        """
        Root mean square distance of the neighbours from their plane, √λ3 [m].

        """
        return np.sqrt(self.eigenvalues[:, 2])

    @property
    def verticality(self) -> NDArray[np.float64]:
        """
        1 − n_z: 0 on level surfaces, 1 on walls.

        """
        return 1.0 - self.normals[:, 2]


def eigen_features(points: ArrayLike, radii: Sequence[float], *, min_neighbours: int = 4) -> EigenFeatures:
    """
    Describe each point's spherical neighbourhood, its radius chosen by least entropy.

    For every radius the covariance of the points within it about their mean gives λ1 ≥ λ2 ≥ λ3; the one is
    taken at which the shape is least ambiguous between line, plane and volume: the entropy of
    a1 = (σ1 − σ2)/σ1, a2 = (σ2 − σ3)/σ1, a3 = σ3/σ1 with σ = √λ is smallest (Demantké and others, 2011).
    One pass over the neighbours of the largest radius serves all of them: moments are summed in shells.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        In any order [m].
    radii : sequence of float
        Rising [m], > 0; a single one fixes the radius.
    min_neighbours : int
        Radii with fewer points are passed over, but for the largest one.

    Returns
    -------
    EigenFeatures
        Rows as in the input. A point alone has λ = 0 and a normal straight up.

    Raises
    ------
    ValueError
        If `points` has another shape or is not finite, or `radii` are not positive and rising.

    Notes
    -----
    Neighbours are summed in an order that depends on coordinates alone, so neither the order of rows nor
    the number of threads changes a bit of the result. Where the nine grid columns, each as wide as the
    largest radius, hold more than `MAX_CANDIDATES` points within reach, evenly spaced ones stand for all.

    """
    steps = np.asarray(radii, dtype=np.float64)
    if steps.ndim != 1 or len(steps) == 0 or not (steps[0] > 0 and np.all(np.diff(steps) > 0)):
        raise ValueError(f"radii = {list(radii)!r}: must be positive, rising lengths [m]")
    grid = build_grid(points, float(steps[-1]))
    squares = steps**2
    # Squared distance → a shell that is not too far out; few bins hold a limit between two shells.
    lookup = np.searchsorted(squares, np.arange(LOOKUP_BINS) * (squares[-1] / LOOKUP_BINS) * (1 - 1e-9))
    n = len(grid.points)
    found = EigenFeatures(np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n), np.zeros(n, dtype=np.int64))
    for_row_blocks(
        lambda begin, end: _describe(
            grid,
            squares,
            lookup,
            min_neighbours,
            found.eigenvalues,
            found.normals,
            found.radius,
            found.n_neighbours,
            begin,
            end,
        ),
        n,
    )
    return found


def _ratio(part: NDArray[np.float64], whole: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Divide, 0 where there is nothing to divide by.

    """
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)


@njit(cache=True, nogil=True)
def _describe(  # type: ignore[no-untyped-def]
    grid, squares, lookup, min_neighbours, eigenvalues, normals, radius, n_neighbours, begin, end
):
    """
    Fill the output rows of sorted points begin to end.

    """
    shells = np.empty((len(squares), 10))
    near = np.empty((MAX_CANDIDATES + 9, 4))
    ranges = np.empty((9, 2), dtype=np.int64)
    for i in range(begin, end):
        n_near = _gather(grid, squares[-1], i, ranges, near)
        _sum_shells(near[:n_near], squares, lookup, shells)
        row = grid.rows[i]
        best = _choose_radius(shells, min_neighbours, eigenvalues[row])
        # The shells have become sums within each radius.
        normals[row] = smallest_eigenvector_3x3(*_covariance(shells[best]))
        radius[row] = np.sqrt(squares[best])
        n_neighbours[row] = int(shells[best, 0])


@njit(cache=True, nogil=True)
def _gather(grid, square_reach, i, ranges, near):  # type: ignore[no-untyped-def]
    """
    Write dx, dy, dz and the squared distance of the neighbours of sorted point i; return how many.

    """
    points = grid.points
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    reach = np.sqrt(square_reach)
    candidates, n_ranges, found = 0, 0, 0
    for c in grid.adjacent[grid.cell[i]]:
        if c >= 0:
            start, stop = z_range(points[:, 2], grid.first[c], grid.first[c + 1], z - reach, z + reach)
            ranges[n_ranges, 0], ranges[n_ranges, 1] = start, stop
            candidates += stop - start
            n_ranges += 1
    stride = 1 + (candidates - 1) // MAX_CANDIDATES
    for k in range(n_ranges):
        for j in range(ranges[k, 0], ranges[k, 1], stride):
            dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
            square = dx * dx + dy * dy + dz * dz
            # Written always, kept if near: a branch here would be mispredicted half of the time.
            near[found, 0], near[found, 1], near[found, 2], near[found, 3] = dx, dy, dz, square
            found += square <= square_reach
    return found


@njit(cache=True, nogil=True)
def _sum_shells(near, squares, lookup, shells):  # type: ignore[no-untyped-def]
    """
    Sum 1, d and d dᵀ over the neighbours between one radius and the next.

    """
    shells[:] = 0.0
    scale = len(lookup) / squares[-1]
    for j in range(len(near)):
        dx, dy, dz, square = near[j, 0], near[j, 1], near[j, 2], near[j, 3]
        k = lookup[min(int(square * scale), len(lookup) - 1)]
        while square > squares[k]:
            k += 1
        shell = shells[k]
        shell[0] += 1.0
        shell[1] += dx
        shell[2] += dy
        shell[3] += dz
        shell[4] += dx * dx
        shell[5] += dx * dy
        shell[6] += dx * dz
        shell[7] += dy * dy
        shell[8] += dy * dz
        shell[9] += dz * dz


@njit(cache=True, nogil=True)
def _choose_radius(shells, min_neighbours, eigenvalues):  # type: ignore[no-untyped-def]
    """
    Turn shells into sums within each radius; return the radius of least entropy, its eigenvalues written.

    """
    last = len(shells) - 1
    best, least = last, np.inf
    for k in range(last + 1):
        if k > 0:
            for moment in range(10):
                shells[k, moment] += shells[k - 1, moment]
        if k < last and shells[k, 0] < min_neighbours:
            continue
        found = eigenvalues_3x3(*_covariance(shells[k]))
        entropy = _entropy(found)
        if entropy < least or best == k:
            best, least = k, entropy
            eigenvalues[0], eigenvalues[1], eigenvalues[2] = found
    return best


@njit(cache=True, nogil=True)
def _covariance(sums):  # type: ignore[no-untyped-def]
    """
    Return xx, xy, xz, yy, yz, zz of the covariance about the mean, 0 for fewer than two points.

    """
    n = sums[0]
    if n < 2:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x, y, z = sums[1] / n, sums[2] / n, sums[3] / n
    return (
        max(sums[4] / n - x * x, 0.0),
        sums[5] / n - x * y,
        sums[6] / n - x * z,
        max(sums[7] / n - y * y, 0.0),
        sums[8] / n - y * z,
        max(sums[9] / n - z * z, 0.0),
    )


@njit(cache=True, nogil=True)
def _entropy(eigenvalues):  # type: ignore[no-untyped-def]
    """
    Return the entropy of the dimensionality shares, infinite where all neighbours coincide.

    """
    if eigenvalues[0] <= 0.0:
        return np.inf
    s1, s2, s3 = np.sqrt(eigenvalues[0]), np.sqrt(eigenvalues[1]), np.sqrt(eigenvalues[2])
    total = 0.0
    for share in ((s1 - s2) / s1, (s2 - s3) / s1, s3 / s1):
        if share > 0.0:
            total -= share * np.log(share)
    return total
