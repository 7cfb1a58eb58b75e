"""
The measured point spacing, the yardstick of most other lengths.

"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.point_array import checked_points

#: Spacing of a cloud that has none (fewer than two distinct positions) [m].
FALLBACK_SPACING = 1.0
#: Quantised spacings are powers of this ratio: neighbouring tiles mostly fall on the same one.
QUANTUM = 2.0**0.25
#: Neighbours that a density is estimated from: enough to bridge the unequal steps along and across the scan.
NEIGHBOURS = 16
#: Positions at which the density is probed; the median of so many is steady to a percent.
MAX_PROBES = 20_000
#: Distances beyond this multiple of the median weigh no more: a few strays far off have no say.
MAX_STRAY = 3.0

#: A spacing within this factor of the expected one is taken for it: two strips on one another are √2 denser.
MAX_DEVIATION = 1.6


def measure_spacing(points: ArrayLike) -> float:
    """
    Measure the point spacing, 1/√density, of a cloud seen from above.

    The density at a point is that of the disc reaching to its k-th neighbour in plan, k/(π d²). The median,
    weighted by the area of the discs, is the density of the middle of the occupied area: holes, the
    surroundings of the cloud and overlaps of strips over less than half of it do not count, and repeated
    positions count once.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        In any order [m].

    Returns
    -------
    float
        Spacing [m], > 0; `FALLBACK_SPACING` if there are fewer than two distinct positions.

    Raises
    ------
    ValueError
        If `points` has another shape or is not finite.

    Notes
    -----
    Order of points does not matter. Some million points a second on one core.

    """
    x, y, _ = checked_points(points).T
    positions = _distinct(x + 1j * y)
    if len(positions) < 2:
        return FALLBACK_SPACING
    # In a small cloud most points lie near its edge: fewer neighbours reach less far beyond it.
    k = min(NEIGHBOURS, max(1, len(positions) // 10))
    plan = positions.view(np.float64).reshape(-1, 2)
    tree = cKDTree(plan, balanced_tree=False, compact_nodes=False)
    probes = plan[:: math.ceil(len(plan) / MAX_PROBES)]
    # The nearest one found is the point itself.
    distance = np.sort(tree.query(probes, [k + 1])[0].ravel())
    area = np.cumsum(np.minimum(distance, MAX_STRAY * np.median(distance)) ** 2)
    middle = distance[np.searchsorted(area, 0.5 * area[-1])]
    # Between a lattice (k) and the area-weighted median of a Poisson process (k + 2/3).
    return float(middle * math.sqrt(math.pi / (k + 1 / 3)))


def _distinct(positions: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """
    Return the distinct positions by x, then y; some times faster than numpy's unique.

    """
    positions = np.sort(positions)
    differs = np.ones(len(positions), dtype=np.bool_)
    differs[1:] = positions[1:] != positions[:-1]
    return positions[differs]


def steady_spacing(points: ArrayLike, expected: float | None) -> float:
    """
    Return the expected spacing where the points bear it out, else their own, quantised.

    With one expectation for a whole survey neighbouring tiles use the same spacing, and a tile of another
    density still its own.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        In any order [m].
    expected : float or None
        What the survey's points have in general [m].

    Returns
    -------
    float
        Spacing [m].

    """
    measured = measure_spacing(points)
    if expected is not None and 1 / MAX_DEVIATION <= measured / expected <= MAX_DEVIATION:
        return expected
    return _quantised(measured)


def quantised_spacing(points: ArrayLike) -> float:
    """
    Measure the point spacing and round it to the nearest power of 2^(1/4).

    Neighbouring tiles whose spacings differ a little so get the same value, unless they lie on either side
    of a rounding limit.

    Parameters
    ----------
    points : array_like of shape (n_points, 3)
        In any order [m].

    Returns
    -------
    float
        Spacing [m]; `FALLBACK_SPACING` (a power itself) where there is none to measure.

    """
    return _quantised(measure_spacing(points))


def _quantised(spacing: float) -> float:
    """
    Round to the nearest power of the quantum.

    """
    return float(QUANTUM ** round(math.log(spacing, QUANTUM)))
