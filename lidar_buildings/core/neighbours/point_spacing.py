"""The measured point spacing, the yardstick of most other lengths."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.point_array import checked_points
from lidar_buildings.core.neighbours.cell_grid import cell_numbers
from lidar_buildings.core.neighbours.nearest_neighbours import nth_distances
from lidar_buildings.core.neighbours.parallel import for_row_blocks

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
#: Points of the strips that positions are sorted in, on average, and the most that are sorted by insertion.
POINTS_A_STRIP, LARGE_STRIP = 8, 64

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
    not count, and repeated positions count once. Order of points does not matter. Some million points a
    second on one core.

    `FALLBACK_SPACING` if there are fewer than two distinct positions. ValueError if `points` has another
    shape or is not finite.
    """
    x, y, _ = checked_points(points).T
    positions = distinct_positions(x, y)
    if len(positions) < 2:
        return FALLBACK_SPACING
    # In a small cloud most points lie near its edge: fewer neighbours reach less far beyond it.
    k = min(NEIGHBOURS, max(1, len(positions) // 10))
    plan = positions.view(np.float64).reshape(-1, 2)
    step = math.ceil(len(plan) / max_probes)
    distance, reach = nth_distances(plan, step, k)
    middle, median = middle_of(distance)
    if not (math.isfinite(middle) and reach >= MAX_STRAY * median):
        # Too many have their neighbours farther off than is usual for it not to matter how far.
        tree = cKDTree(plan, balanced_tree=False, compact_nodes=False)
        # The nearest one found is the point itself.
        middle, _ = middle_of(tree.query(plan[::step], [k + 1])[0].ravel())
    # Between a lattice (k) and the area-weighted median of a Poisson process (k + 2/3).
    return middle * math.sqrt(math.pi / (k + 1 / 3))


def middle_of(distance: NDArray[np.float64]) -> tuple[float, float]:
    """Return the median weighted by area, infinite if it is not known, and the plain one."""
    distance, half = np.sort(distance), len(distance) // 2
    median = float(distance[half] if len(distance) % 2 else 0.5 * (distance[half - 1] + distance[half]))
    if not math.isfinite(median):
        return math.inf, math.inf
    area = np.cumsum(np.minimum(distance, MAX_STRAY * median) ** 2)
    return float(distance[np.searchsorted(area, 0.5 * area[-1])]), median


def distinct_positions(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.complex128]:
    """
    Return the distinct positions x + iy by x, then y.

    Points are put into narrow strips by x, which are sorted one by one, on all cores: 0.3 s for two million
    points, for which numpy's unique takes more than 3 s.
    """
    if len(x) == 0:
        return np.zeros(0, dtype=np.complex128)
    low, n_strips = float(x.min()), 1 + len(x) // POINTS_A_STRIP
    width = (float(x.max()) - low) / n_strips
    first = np.zeros(n_strips + 1, dtype=np.int64)
    positions = _by_strip(x, y, low, width, first)
    for_row_blocks(lambda a, b: _sort_strips(positions, first, a, b), n_strips)
    for k in np.flatnonzero(np.diff(first) > LARGE_STRIP):
        positions[first[k] : first[k + 1]].sort()
    differs = np.ones(len(positions), dtype=np.bool_)
    differs[1:] = positions[1:] != positions[:-1]
    return positions if differs.all() else positions[differs]


@kernel
def _by_strip(x, y, low, width, first):  # type: ignore[no-untyped-def]
    """Return positions strip by strip, and write to `first` where each strip begins."""
    last = len(first) - 2
    strip = np.zeros(len(x), dtype=np.int32)
    for i in range(len(x)):
        if 0.0 < width < np.inf:
            strip[i] = min(np.int64((x[i] - low) / width), last)
        first[strip[i] + 1] += 1
    for k in range(1, len(first)):
        first[k] += first[k - 1]
    place = first[:-1].copy()
    positions = np.empty(len(x), dtype=np.complex128)
    for i in range(len(x)):
        positions[place[strip[i]]] = complex(x[i], y[i])
        place[strip[i]] += 1
    return positions


@kernel
def _sort_strips(positions, first, begin, end):  # type: ignore[no-untyped-def]
    """Sort the positions within the strips begin to end, but for large ones, by insertion."""
    for k in range(begin, end):
        if first[k + 1] - first[k] > LARGE_STRIP:
            continue
        for i in range(first[k] + 1, first[k + 1]):
            one = positions[i]
            j = i
            while j > first[k] and _comes_first(one, positions[j - 1]):
                positions[j] = positions[j - 1]
                j -= 1
            positions[j] = one


@kernel
def _comes_first(one, other):  # type: ignore[no-untyped-def]
    """Whether a position comes before another by x, then y."""
    return one.real < other.real or (one.real == other.real and one.imag < other.imag)


def steady_spacing(points: ArrayLike, expected: float | None) -> float:
    """
    Return the expected spacing where the points bear it out, else their own, quantised [m].

    With one expectation for a whole survey neighbouring tiles use the same spacing, and a tile of another
    density still its own. None is less than `FINEST`.
    """
    return max(_of_survey_or_own(points, expected), FINEST)


def _of_survey_or_own(points: ArrayLike, expected: float | None) -> float:
    if expected is not None and _has_plainly(checked_points(points), expected):
        return expected
    measured = measure_spacing(points)
    if expected is not None and 1 / MAX_DEVIATION <= measured / expected <= MAX_DEVIATION:
        return expected
    return rounded_spacing(measured)


def _has_plainly(points: NDArray[np.float64], spacing: float) -> bool:
    """
    Whether cells, counted in a tenth of the time of measuring, hold about as many points as expected.

    Both half of the cells and half of the points have to say so: where they do not, density is uneven.
    """
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
    """
    Measure the point spacing and round it to the nearest power of 2^(1/4) [m].

    Neighbouring tiles whose spacings differ a little so get the same value, unless they lie on either side of
    a rounding limit. `FALLBACK_SPACING` (a power itself) where there is none to measure.
    """
    return rounded_spacing(measure_spacing(points))


def given_or_measured(points: ArrayLike, point_spacing: float | None) -> float:
    """
    Return the spacing that a stage's lengths are multiples of: as given, or else measured and rounded [m].

    ValueError if the spacing given is no positive length, or `points` are not as for `measure_spacing`.
    """
    if point_spacing is None:
        return quantised_spacing(points)
    if not (math.isfinite(point_spacing) and point_spacing > 0):
        raise ValueError(f"point_spacing = {point_spacing!r}: must be a positive length [m]")
    return float(point_spacing)


def rounded_spacing(spacing: float) -> float:
    """Round a spacing [m] to the nearest power of 2^(1/4)."""
    if spacing == 0.0:  # distances so small that their squares are
        return FALLBACK_SPACING
    if not math.isfinite(spacing):
        raise ValueError("points lie so far apart that squares of distances overflow: give metres")
    return float(QUANTUM ** round(math.log(spacing, QUANTUM)))
