"""Shape of every point's neighbourhood, from the eigenvalues of its covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.surfaces.point_moments import N_MOMENTS
from lidar_buildings.core.surfaces.symmetric_eigen import eigenvalues_3x3, values_and_normal

#: Cells a block of work: some thousand points.
CELLS_A_BLOCK = 512
#: Radii whose squares are numbers, and can be divided by [m].
SMALLEST_RADIUS, LARGEST_RADIUS = 1e-100, 1e100
#: Cells are wider than they need be by so much, lest rounding puts a point at the very radius out of reach.
SLACK = 1.0 + 1e-9
#: Points looked at around one cell, where there are more as many evenly spaced ones; and as many as tell a
#: plane and its roughness: a third of them is within reach.
MAX_CANDIDATES, PLANE_CANDIDATES = 4608, 768
#: Shares of a shape below this count as nothing; no logarithm of 0.
SMALLEST_SHARE = 1e-200


@dataclass(frozen=True, eq=False)
class EigenFeatures:
    """
    What principal component analysis says of each point's neighbourhood.

    Features are of the eigenvalues λ, not of their square roots. They are 0 where all neighbours coincide.
    """

    #: λ1 ≥ λ2 ≥ λ3 ≥ 0 of the covariance about the mean [m²], shape (n_points, 3).
    eigenvalues: NDArray[np.float64]
    #: Unit direction of λ3, z ≥ 0; the most upward one where it is not unique, shape (n_points, 3).
    normals: NDArray[np.float64]
    radius: NDArray[np.float64]  #: radius of the neighbourhood [m], shape (n_points,)
    n_neighbours: NDArray[np.int64]  #: points within the radius, the point itself included, shape (n_points,)

    @property
    def linearity(self) -> NDArray[np.float64]:
        """(λ1 − λ2)/λ1."""
        return self._share(self.eigenvalues[:, 0] - self.eigenvalues[:, 1])

    @property
    def planarity(self) -> NDArray[np.float64]:
        """(λ2 − λ3)/λ1."""
        return self._share(self.eigenvalues[:, 1] - self.eigenvalues[:, 2])

    @property
    def scattering(self) -> NDArray[np.float64]:
        """λ3/λ1."""
        return self._share(self.eigenvalues[:, 2])

    @property
    def roughness(self) -> NDArray[np.float64]:
        """Root mean square distance of the neighbours from their plane, √λ3 [m]."""
        return np.sqrt(self.eigenvalues[:, 2])

    @property
    def verticality(self) -> NDArray[np.float64]:
        """1 − n_z: 0 on level surfaces, 1 on walls."""
        return 1.0 - self.normals[:, 2]

    def _share(self, part: NDArray[np.float64]) -> NDArray[np.float64]:
        first = self.eigenvalues[:, 0]
        return np.divide(part, first, out=np.zeros_like(part), where=first > 0)


def eigen_features(
    points: ArrayLike,
    radii: Sequence[float],
    *,
    min_neighbours: int = 4,
    max_candidates: int = MAX_CANDIDATES,
) -> EigenFeatures:
    """
    Describe each point's spherical neighbourhood, its radius chosen by least entropy.

    For every radius the covariance of the points within it about their mean gives λ1 ≥ λ2 ≥ λ3; the one is
    taken at which the shape is least ambiguous: the entropy of the shares of line, plane and volume,
    a1 = (σ1 − σ2)/σ1, a2 = (σ2 − σ3)/σ1, a3 = σ3/σ1 with σ = √λ, is smallest (Demantké and others, 2011). One
    pass over the neighbours of the largest radius serves all of them: moments are summed in shells.

    - `points`, shape (n_points, 3): In any order [m].
    - `radii`, sequence of float: Rising [m], > 0; a single one fixes the radius.
    - `min_neighbours`: Radii with fewer points are passed over, but for the largest one; ≥ 1.
    - `max_candidates`: Points looked at around a cell as wide as the largest radius; where there are more, so
      many evenly spaced ones stand for all; ≥ 1.

    Returned: rows as in the input. A point alone has λ = 0 and a normal straight up. ValueError if `points`
    has another shape or is not finite, or a parameter is none of what is allowed. Coordinates are taken from
    the point itself, so the distance of the origin does not matter, and summed in an order that depends on
    them alone. Time is proportional to the number of neighbours within the largest radius.
    """
    squares = _checked_radii(radii) ** 2
    for name, value in (("min_neighbours", min_neighbours), ("max_candidates", max_candidates)):
        if value < 1:
            raise ValueError(f"{name} = {value!r}: must be at least 1")
    cloud = sort_by_cell(checked_points(points), SLACK * math.sqrt(squares[-1]))
    runs, n = cloud.first[cloud.around(cloud.size)], len(cloud.points)
    found = EigenFeatures(np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.empty(n, dtype=np.int64))
    outputs = (found.eigenvalues, found.normals, found.radius, found.n_neighbours)
    for_row_blocks(
        lambda a, b: _describe(cloud, runs, squares, min_neighbours, max_candidates, outputs, a, b),
        len(cloud.numbers),
        CELLS_A_BLOCK,
    )
    return found


def _checked_radii(radii: Sequence[float]) -> NDArray[np.float64]:
    steps = np.asarray(radii, dtype=np.float64)
    rising = steps.ndim == 1 and len(steps) > 0 and steps[0] > 0 and bool(np.all(np.diff(steps) > 0))
    if not (rising and steps[0] >= SMALLEST_RADIUS and steps[-1] <= LARGEST_RADIUS):
        raise ValueError(
            f"radii = {list(radii)!r}: must be positive, rising lengths within {SMALLEST_RADIUS:g} to "
            f"{LARGEST_RADIUS:g} m"
        )
    return steps


@kernel
def _describe(cloud, runs, squares, min_neighbours, max_candidates, found, begin, end):  # type: ignore[no-untyped-def]
    """Describe the neighbourhoods of the points in cells begin to end."""
    reach, n_radii = math.sqrt(squares[-1]), len(squares)
    points, first, rows_of = cloud.points, cloud.first, cloud.rows
    eigenvalues, normals, radius, n_neighbours = found
    near = np.empty((3, max_candidates))
    near_x, near_y, near_z = near
    square = np.empty(max_candidates)
    rows, own = np.empty((2, max_candidates), dtype=np.int64)
    shells, covariance = np.empty((n_radii, N_MOMENTS)), np.empty(6)
    for cell in range(begin, end):
        stop = first[cell]
        while stop < first[cell + 1]:
            # Points that rise by no more than the radius share their candidates.
            start, top = stop, points[stop, 2] + reach
            while stop < first[cell + 1] and points[stop, 2] <= top:
                stop += 1
            n_near = _gather(points, runs, cell, points[start, 2] - reach, points[stop - 1, 2] + reach, near)
            for i in range(start, stop):
                x, y, z = points[i, 0], points[i, 1], points[i, 2]
                for j in range(n_near):
                    dx, dy, dz = near_x[j] - x, near_y[j] - y, near_z[j] - z
                    square[j] = dx * dx + dy * dy + dz * dz
                n_within, most = np.int64(0), squares[n_radii - 1]
                for j in range(n_near):
                    # Written always, kept if near: a branch here would be mispredicted half of the time.
                    rows[n_within] = j
                    n_within += square[j] <= most
                for k in range(n_radii - 1):
                    n_own, n_within = _split(square, squares[k], rows, n_within, own)
                    _add_up(near, own, n_own, x, y, z, shells[k])
                _add_up(near, rows, n_within, x, y, z, shells[n_radii - 1])
                best, least = n_radii - 1, np.inf
                for k in range(n_radii):
                    if k > 0:
                        for moment in range(N_MOMENTS):
                            shells[k, moment] += shells[k - 1, moment]
                    if n_radii > 1 and (shells[k, 0] >= min_neighbours or k == n_radii - 1):
                        _covariance(shells, k, covariance)
                        entropy = entropy_of_shape(covariance)
                        if entropy < least:
                            best, least = k, entropy
                _covariance(shells, best, covariance)
                row = rows_of[i]
                eigenvalues[row, 0], eigenvalues[row, 1], eigenvalues[row, 2], nx, ny, nz = values_and_normal(
                    covariance[0], covariance[1], covariance[2], covariance[3], covariance[4], covariance[5]
                )
                normals[row, 0], normals[row, 1], normals[row, 2] = nx, ny, nz
                radius[row], n_neighbours[row] = math.sqrt(squares[best]), np.int64(shells[best, 0])


@kernel
def _gather(points, runs, cell, low, high, near):  # type: ignore[no-untyped-def]
    """Write the points of a cell's runs from elevation `low` to `high`, evenly thinned; return how many."""
    candidates = 0
    for row in range(runs.shape[1]):
        for j in range(runs[cell, row, 0], runs[cell, row, 1]):
            candidates += low <= points[j, 2] <= high
    # Each counts for its share of the room; one is taken whenever shares make a whole.
    room, seen, found = min(candidates, near.shape[1]), 0, 0
    for row in range(runs.shape[1]):
        for j in range(runs[cell, row, 0], runs[cell, row, 1]):
            if low <= points[j, 2] <= high:
                seen += room
                if seen >= candidates:
                    near[0, found], near[1, found], near[2, found] = points[j, 0], points[j, 1], points[j, 2]
                    found += 1
                    seen -= candidates
    return found


@kernel
def _split(square, limit, rows, n_rows, own):  # type: ignore[no-untyped-def]
    """Move rows up to a limit out of the first `n_rows` to `own`; return how many went, how many are left."""
    n_own, n_left = 0, 0
    for one in range(n_rows):
        row = rows[one]
        is_own = square[row] <= limit
        own[n_own], rows[n_left] = row, row
        n_own += is_own
        n_left += not is_own
    return n_own, n_left


@kernel
def _add_up(near, rows, n_rows, x, y, z, sums):  # type: ignore[no-untyped-def]
    """Write the moments of the first `n_rows` rows' points about a place."""
    # Numbers stay in registers: sums in an array would be written and read again for each point.
    sx, sy, sz, xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    near_x, near_y, near_z = near
    for one in range(n_rows):
        row = rows[one]
        dx, dy, dz = near_x[row] - x, near_y[row] - y, near_z[row] - z
        sx, sy, sz = sx + dx, sy + dy, sz + dz
        xx, xy, xz = xx + dx * dx, xy + dx * dy, xz + dx * dz
        yy, yz, zz = yy + dy * dy, yz + dy * dz, zz + dz * dz
    sums[0], sums[1], sums[2], sums[3] = n_rows, sx, sy, sz
    sums[4], sums[5], sums[6], sums[7], sums[8], sums[9] = xx, xy, xz, yy, yz, zz


@kernel
def _covariance(sums, k, covariance):  # type: ignore[no-untyped-def]
    """Write xx, xy, xz, yy, yz, zz about the mean of row k, 0 for fewer than two points."""
    share = 1.0 / max(sums[k, 0], 1.0)
    x, y, z = sums[k, 1] * share, sums[k, 2] * share, sums[k, 3] * share
    covariance[0] = max(sums[k, 4] * share - x * x, 0.0)
    covariance[1], covariance[2] = sums[k, 5] * share - x * y, sums[k, 6] * share - x * z
    covariance[3] = max(sums[k, 7] * share - y * y, 0.0)
    covariance[4] = sums[k, 8] * share - y * z
    covariance[5] = max(sums[k, 9] * share - z * z, 0.0)


@kernel
def entropy_of_shape(covariance):  # type: ignore[no-untyped-def]
    """
    Return the entropy of a covariance xx, xy, xz, yy, yz, zz, infinite where all neighbours coincide.

    That of a1 = (σ1 − σ2)/σ1, a2 = (σ2 − σ3)/σ1, a3 = σ3/σ1 with σ = √λ (Demantké and others, 2011).
    """
    if covariance[0] + covariance[3] + covariance[5] <= 0.0:
        return np.inf
    first, second, third = eigenvalues_3x3(
        covariance[0], covariance[1], covariance[2], covariance[3], covariance[4], covariance[5]
    )
    s1, s2, s3 = math.sqrt(first), math.sqrt(second), math.sqrt(third)
    a1, a2 = max((s1 - s2) / s1, SMALLEST_SHARE), max((s2 - s3) / s1, SMALLEST_SHARE)
    a3 = max(s3 / s1, SMALLEST_SHARE)
    return -a1 * math.log(a1) - a2 * math.log(a2) - a3 * math.log(a3)
