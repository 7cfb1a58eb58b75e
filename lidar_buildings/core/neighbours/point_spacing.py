"""The measured point spacing, the yardstick of most other lengths."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.bounds import SPACINGS, checked_spacing
from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.neighbours.cell_grid import CellGrid, cell_numbers

#: Spacing of a cloud that has none (fewer than two distinct positions) [m].
FALLBACK_SPACING = 1.0
#: Quantised spacings are powers of this ratio: neighbouring tiles mostly fall on the same one.
QUANTUM = 2.0**0.25
#: Neighbours that a density is estimated from: enough to bridge the unequal steps along and across the scan.
NEIGHBOURS = 16
#: Positions at which the density is probed; the median of so many is steady to a percent.
MAX_PROBES = 20_000
#: Positions that are enough where a few percent do not matter, as within one building.
FEW_PROBES = 200
#: Distances beyond this multiple of the median weigh no more: a few strays far off have no say.
MAX_STRAY = 3.0

#: What is measured more densely is taken for as dense as this [m]: no building has details so fine.
FINEST = 2.0**-3.25
#: A spacing within this factor of the expected one is taken for it: two strips on one another are √2 denser.
MAX_DEVIATION = 1.6
#: One within this factor by the points in cells of so many spacings is within that one when measured.
PLAIN_DEVIATION, CELL_TO_COUNT = 1.48, 4.0


def measure_spacing(points: ArrayLike, max_probes: int = MAX_PROBES) -> float:
    """
    Measure the point spacing, 1/√density [m], of a cloud (n_points, 3) [m] seen from above.

    The density at a point, one of `max_probes` at most, is that of the disc reaching to its k-th neighbour in
    plan, k/(π d²). The median, weighted by the area of the discs, is the density of the middle of the
    occupied area: holes, the surroundings of the cloud and overlaps of strips over less than half of it do
    not count, and repeated positions count once. Order of points does not matter. `FALLBACK_SPACING` if there
    are fewer than two distinct positions. ValueError if `points` has another shape or is not finite.
    """
    plan = distinct_positions(checked_points(points))
    if len(plan) < 2:
        return FALLBACK_SPACING
    # In a small cloud most points lie near its edge: fewer neighbours reach less far beyond it.
    k = min(NEIGHBOURS, max(1, len(plan) // 10))
    tree = cKDTree(plan, balanced_tree=False, compact_nodes=False)
    # The nearest one found is the point itself.
    middle = _middle_of(tree.query(plan[:: math.ceil(len(plan) / max_probes)], [k + 1])[0].ravel())
    # Between a lattice (k) and the area-weighted median of a Poisson process (k + 2/3).
    return middle * math.sqrt(math.pi / (k + 1 / 3))


def surface_spacings(points: ArrayLike, max_probes: int = MAX_PROBES) -> NDArray[np.float64]:
    """
    Measure the spacing on surfaces about some points of a cloud (n_points, 3) seen from the side [m], rising.

    As `measure_spacing`, but with neighbours in space: in plan the points of a wall lie on one another, and
    from the street the spacing grows with the distance from the scanner, so that one number says little.
    Empty for fewer than `NEIGHBOURS` points.
    """
    cloud = checked_points(points)
    if len(cloud) <= NEIGHBOURS:
        return np.empty(0)
    tree = cKDTree(cloud, balanced_tree=False, compact_nodes=False)
    distance = tree.query(cloud[:: math.ceil(len(cloud) / max_probes)], [NEIGHBOURS + 1])[0].ravel()
    return np.sort(distance) * math.sqrt(math.pi / (NEIGHBOURS + 1 / 3))


def distinct_positions(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distinct positions in plan by x, then y, shape (n_positions, 2) [m]."""
    plan = points[np.lexsort((points[:, 1], points[:, 0])), :2]
    is_new = np.ones(len(plan), dtype=np.bool_)
    is_new[1:] = (plan[1:] != plan[:-1]).any(axis=1)
    return plan[is_new]


def _middle_of(distance: NDArray[np.float64]) -> float:
    """Return the median weighted by area, infinite if it is not known."""
    distance, half = np.sort(distance), len(distance) // 2
    median = float(distance[half] if len(distance) % 2 else 0.5 * (distance[half - 1] + distance[half]))
    if not math.isfinite(median):
        return math.inf
    area = np.cumsum(np.minimum(distance, MAX_STRAY * median) ** 2)
    return float(distance[np.searchsorted(area, 0.5 * area[-1])])


def steady_spacing(points: ArrayLike, expected: float | None) -> float:
    """
    Return the expected spacing where the points bear it out, else their own, quantised [m].

    With one expectation for a whole survey neighbouring tiles use the same spacing, and a tile of another
    density still its own. None is less than `FINEST`.
    """
    if expected is not None and _has_plainly(checked_points(points), expected):
        return max(expected, FINEST)
    measured = measure_spacing(points)
    if expected is not None and 1 / MAX_DEVIATION <= measured / expected <= MAX_DEVIATION:
        return max(expected, FINEST)
    return max(rounded_spacing(measured), FINEST)


def _has_plainly(points: NDArray[np.float64], spacing: float) -> bool:
    """Whether cells of most of the area, and of most points, hold about as many as expected; 10 × faster."""
    if not len(points):
        return False
    numbers = cell_numbers(points, CELL_TO_COUNT * spacing)
    if int(numbers.max()) > len(points):  # few and far between
        return False
    count = np.sort(np.bincount(numbers))
    count = count[np.searchsorted(count, 1) :]
    of_points = count[np.searchsorted(np.cumsum(count), 0.5 * len(points))]
    found = CELL_TO_COUNT / np.sqrt([count[len(count) // 2], of_points])
    return bool(np.maximum(found, 1.0 / found).max() <= PLAIN_DEVIATION)


def quantised_spacing(points: ArrayLike) -> float:
    """Measure the point spacing and round it to a power of 2^(1/4) [m], mostly the same for near tiles."""
    return rounded_spacing(measure_spacing(points))


def given_or_measured(points: ArrayLike, point_spacing: float | None) -> float:
    """
    Return the spacing that a stage's lengths are multiples of: as given, or else measured and rounded [m].

    ValueError if the spacing given is no positive length, or `points` are not as for `measure_spacing`.
    """
    if point_spacing is None:
        return quantised_spacing(points)
    return checked_spacing(point_spacing)


def rounded_spacing(spacing: float) -> float:
    """Round a spacing [m] to the nearest power of 2^(1/4) that a spacing can be."""
    if spacing == 0.0:  # distances so small that their squares are
        return FALLBACK_SPACING
    if not math.isfinite(spacing):
        raise ValueError("points lie so far apart that squares of distances overflow: give metres")
    least, most = SPACINGS
    return float(QUANTUM ** round(math.log(min(max(spacing, least), most), QUANTUM)))


#: Groups whose points are sparser than expected by this factor have their own spacing: strips overlap
#: elsewhere. Less than that may be the rim of a small group. Nothing reaches farther than with so much more.
MIN_SPARSER, MAX_SPARSER = 1.35, 4.0
#: Fewest points that each neighbour that a density is estimated from needs in its group.
POINTS_A_NEIGHBOUR = 10
#: Cells on each side in which the neighbours of a group's points are sought.
REACH = 4
#: Multipliers of the hash that picks probes (xorshift64* of Vigna 2016; golden ratio).
_MIX, _GOLDEN = np.uint64(2685821657736338717), np.uint64(0x9E3779B97F4A7C15)


def mark_probes(
    points: NDArray[np.float64], group: NDArray[np.int64], size: NDArray[np.int64], most: int, fewest: int
) -> NDArray[np.bool_]:
    """
    Pick about `most` points of each group, or all of smaller ones, by their coordinates alone.

    Groups of fewer than `fewest` points have none.
    """
    words = np.ascontiguousarray(points[:, :2]).view(np.uint64)
    mixed = words[:, 0] * _GOLDEN + words[:, 1]
    mixed ^= mixed >> np.uint64(31)
    mixed *= _MIX
    mixed ^= mixed >> np.uint64(29)
    mixed *= _MIX
    share = (mixed >> np.uint64(11)).astype(np.float64) / 2.0**53
    own = np.where(group >= 0, size[group], 0) if len(size) else np.zeros(len(group), dtype=np.int64)
    return (own >= max(fewest, 1)) & (share * own < most)


def group_spacings(
    points: NDArray[np.float64], cells: CellGrid, group: NDArray[np.int64], n_groups: int
) -> NDArray[np.float64]:
    """
    Measure 1/√density of each group of points from its own points alone; group −1 is none.

    As `measure_spacing`, but from a sample, and with neighbours sought nearby only, in `cells` a few spacings
    wide. NaN for a group of fewer than 20 points, or most of whose neighbours are not near.
    """
    size = np.bincount(group[group >= 0], minlength=n_groups)
    is_probe = mark_probes(points, group, size, FEW_PROBES, 2 * POINTS_A_NEIGHBOUR)
    probes = np.flatnonzero(is_probe)
    nth = np.minimum(NEIGHBOURS, size // POINTS_A_NEIGHBOUR)
    distance, asking = np.full(len(group), np.inf), cells.holding(is_probe[cells.rows])
    runs = cells.first[cells.around(REACH * cells.size, asking)]
    _find_nth(cells, asking, runs, group, nth, is_probe, REACH * cells.size, distance)
    order = probes[np.argsort(group[probes], kind="stable")]
    first = np.searchsorted(group[order], np.arange(n_groups + 1))
    spacings = np.full(n_groups, np.nan)
    for number in np.flatnonzero(np.diff(first)):
        middle = _middle_of(distance[order[first[number] : first[number + 1]]])
        if 0.0 < middle < math.inf:
            spacings[number] = middle * math.sqrt(math.pi / (nth[number] + 1 / 3))
    return spacings


@kernel
def _find_nth(cells, asking, runs, group, nth, is_probe, reach, distance):  # type: ignore[no-untyped-def]
    """Write how far from each probe the n-th other position of its group is, if within reach."""
    least, x, y = np.empty(NEIGHBOURS + 1), np.empty(NEIGHBOURS + 1), np.empty(NEIGHBOURS + 1)
    for one in range(len(asking)):
        for m in range(cells.first[asking[one]], cells.first[asking[one] + 1]):
            i = cells.rows[m]
            if not is_probe[i]:
                continue
            last = nth[group[i]]  # the nearest one is the point itself
            least[:] = reach * reach
            for row in range(runs.shape[1]):
                for j in range(runs[one, row, 0], runs[one, row, 1]):
                    dx, dy = cells.points[j, 0] - cells.points[m, 0], cells.points[j, 1] - cells.points[m, 1]
                    square, k = dx * dx + dy * dy, last
                    if square >= least[last] or group[cells.rows[j]] != group[i]:
                        continue
                    while k > 0 and least[k - 1] > square:
                        k -= 1
                    is_known, at = False, k - 1
                    while at >= 0 and least[at] == square:
                        is_known |= x[at] == dx and y[at] == dy
                        at -= 1
                    if is_known:
                        continue
                    for at in range(last, k, -1):
                        least[at], x[at], y[at] = least[at - 1], x[at - 1], y[at - 1]
                    least[k], x[k], y[k] = square, dx, dy
            if least[last] < reach * reach:
                distance[i] = math.sqrt(least[last])
