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
from lidar_buildings.core.surfaces.eigenfeatures.moments import shell_lookup
from lidar_buildings.core.surfaces.eigenfeatures.spheres import BATCH_ROWS, WINDOW_REACH, describe_cells

#: Cells a block of work: some thousand points.
CELLS_A_BLOCK = 512
#: Radii whose squares are numbers, and can be divided by [m].
SMALLEST_RADIUS, LARGEST_RADIUS = 1e-100, 1e100
#: Cells are wider than they need be by so much, lest rounding puts a point at the very radius out of reach.
SLACK = 1.0 + 1e-9


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
        return _differences(self.eigenvalues, 0, 1)

    @property
    def planarity(self) -> NDArray[np.float64]:
        """(λ2 − λ3)/λ1."""
        return _differences(self.eigenvalues, 1, 2)

    @property
    def scattering(self) -> NDArray[np.float64]:
        """λ3/λ1."""
        first, _, third = self.eigenvalues.T
        return np.divide(third, first, out=np.zeros_like(third), where=first > 0)

    @property
    def roughness(self) -> NDArray[np.float64]:
        """Root mean square distance of the neighbours from their plane, √λ3 [m]."""
        return np.sqrt(self.eigenvalues[:, 2])

    @property
    def verticality(self) -> NDArray[np.float64]:
        """1 − n_z: 0 on level surfaces, 1 on walls."""
        return 1.0 - self.normals[:, 2]


def eigen_features(points: ArrayLike, radii: Sequence[float], *, min_neighbours: int = 4) -> EigenFeatures:
    """
    Describe each point's spherical neighbourhood, its radius chosen by least entropy.

    For every radius the covariance of the points within it about their mean gives λ1 ≥ λ2 ≥ λ3; the one is
    taken at which the shape is least ambiguous: the entropy of the shares of line, plane and volume,
    a1 = (σ1 − σ2)/σ1, a2 = (σ2 − σ3)/σ1, a3 = σ3/σ1 with σ = √λ, is smallest (Demantké and others, 2011). One
    pass over the neighbours of the largest radius serves all of them: moments are summed in shells.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        In any order [m].
    radii : sequence of float
        Rising [m], > 0, at most `BATCH_ROWS`; a single one fixes the radius.
    min_neighbours : int
        Radii with fewer points are passed over, but for the largest one; ≥ 1.

    Returns
    -------
    EigenFeatures
        Rows as in the input. A point alone has λ = 0 and a normal straight up.

    Raises
    ------
    ValueError
        If `points` has another shape or is not finite, or a parameter is none of what is allowed.

    Notes
    -----
    Coordinates are taken from the point itself, so the distance of the origin does not matter, and summed in
    an order that depends on them alone. Where the cells around hold more than `MAX_CANDIDATES` points, evenly
    spaced ones stand for all. Time is proportional to the number of neighbours within the largest radius.
    """
    squares = _checked_radii(radii) ** 2
    if min_neighbours < 1:
        raise ValueError(f"min_neighbours = {min_neighbours!r}: must be at least 1")
    cloud = sort_by_cell(checked_points(points), SLACK * math.sqrt(squares[-1]) / WINDOW_REACH)
    lookup = shell_lookup(squares)
    n = len(cloud.points)
    outputs = (np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.empty(n, dtype=np.int64))
    for_row_blocks(
        lambda a, b: describe_cells(cloud, squares, lookup, min_neighbours, outputs, a, b),
        len(cloud.numbers),
        CELLS_A_BLOCK,
    )
    return EigenFeatures(*outputs)


def _checked_radii(radii: Sequence[float]) -> NDArray[np.float64]:
    steps = np.asarray(radii, dtype=np.float64)
    rising = steps.ndim == 1 and len(steps) > 0 and steps[0] > 0 and bool(np.all(np.diff(steps) > 0))
    if not (rising and steps[0] >= SMALLEST_RADIUS and steps[-1] <= LARGEST_RADIUS):
        raise ValueError(
            f"radii = {list(radii)!r}: must be positive, rising lengths within {SMALLEST_RADIUS:g} to "
            f"{LARGEST_RADIUS:g} m"
        )
    if len(steps) > BATCH_ROWS:
        raise ValueError(f"radii has {len(steps)} entries: must be at most {BATCH_ROWS}")
    return steps


def _differences(eigenvalues: NDArray[np.float64], larger: int, smaller: int) -> NDArray[np.float64]:
    """Return (λ_larger − λ_smaller)/λ1, counted from 0, and 0 where all neighbours coincide."""
    shares = np.empty(len(eigenvalues))
    for_row_blocks(lambda a, b: _fill_differences(eigenvalues, larger, smaller, shares, a, b), len(shares))
    return shares


@kernel
def _fill_differences(eigenvalues, larger, smaller, shares, begin, end):  # type: ignore[no-untyped-def]
    for i in range(begin, end):
        first = eigenvalues[i, 0]
        difference = eigenvalues[i, larger] - eigenvalues[i, smaller]
        shares[i] = difference / first if first > 0.0 else 0.0
