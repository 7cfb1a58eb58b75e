"""Methods `bidirectional_slope` and `slope_pairs`: slopes along profiles, forth and back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.kernels import inner_kernel, kernel
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.neighbours.parallel import for_row_blocks
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.scan_profiles import Profiles, cut_profiles, find_scan_lines

# Chosen with `bench.ground.isprs`.
#: Width of the strips that are cut as profiles [multiples of the spacing].
WIDTH = 1.7
#: By how much more passes have to call a point ground than object, as a share of all.
AGREEMENT = 0.1
#: Distance over which the terrain is smoothed before its slope is taken off [m]; passes err less on what is
#: left: so much less agreement is asked of them.
TREND_RADIUS, LESS_ON_TREND = 20.0, 0.1


def profile_ground(
    candidates: NDArray[np.float64], spacing: float, config: GroundFilterConfig, scanned: Sequence[Profiles]
) -> NDArray[np.bool_]:
    """
    Tell which candidates are ground by walking along profiles in both directions.

    Where a profile rises by a step it leaves the ground, and is back on it where it has come down to the
    elevation it left (Shan & Sampath 2005). Profiles are the scan lines, where the cloud has any, and strips
    cut in `profile_directions` directions; passes in all directions vote. Ground is then grown along the
    profiles by local regression, the slope of the terrain taken off, and all repeated. Candidates, at least
    one and at most one a cell, have shape (n, 3) and a mean `spacing` [m]; gross errors are removed.
    `scanned` are the scan lines, see `find_scan_lines`.
    """
    n = config.profile_directions
    profiles = [cut_profiles(candidates, WIDTH * spacing, 180.0 * k / n) for k in range(n)]
    profiles += scanned
    z = candidates[:, 2]
    ground = grow_ground(profiles, z, net_votes(profiles, z, config) > AGREEMENT, spacing)
    if ground.any():
        height = z - fit_trend(candidates, ground, TREND_RADIUS)
        ground = net_votes(profiles, height, config) > AGREEMENT - LESS_ON_TREND
        ground = grow_ground(profiles, z, ground, spacing)
    return reject_outliers(profiles, z, ground, spacing, config.profile_step)


#: What a pass says of a point, in half votes; likely ground may yet turn out to be the roof that it began on.
OBJECT, UNKNOWN, LIKELY, GROUND = -2, 0, 1, 2
# Chosen with `bench.ground.isprs`.
#: Where a profile's beginning falls by more than this, it began on an object [m].
FALL = 1.5
#: How steeply the ground behind an object may lie above the ground before it, rise over run.
REENTRY_SLOPE = 0.05
#: How far back along a profile a rise is looked for [m].
WINDOW = 1.0
#: Distance over which a pass forgets the slope of the ground that it came over [m].
SLOPE_MEMORY = 10.0
#: Steps shorter than this say little about the slope [m].
MIN_RUN = 0.5
#: Steepest slope that a pass expects to go on behind an object, rise over run.
MAX_TREND = 1.0


def net_votes(
    profiles: Sequence[Profiles], elevation: NDArray[np.float64], config: GroundFilterConfig
) -> NDArray[np.float64]:
    """
    Return by how much more passes call a point ground than object, as a share of all passes: −1 to 1.

    Each set of profiles is walked forth and back (Shan & Sampath 2005). A point is object from where the
    profile rises by a step until it has come back to the elevation of the last ground point; so what lies
    between a rise and a fall is object in both directions, and what lies above a single step, such as a
    terrace, in one. Elevations may be heights above a trend.
    """
    limits = config.profile_max_slope, config.profile_step, config.profile_max_object, WINDOW
    z = np.ascontiguousarray(elevation)
    votes = np.zeros((len(profiles), len(z)), dtype=np.int8)

    def label(begin: int, end: int) -> None:
        for k in range(begin, end):
            one = profiles[k]
            _label_both_ways(one.rows, one.first, one.along, z, limits, votes[k])

    for_row_blocks(label, len(profiles), 1)
    return votes.sum(axis=0, dtype=np.int64) / (2.0 * GROUND * max(len(profiles), 1))


@kernel
def _label_both_ways(rows, first, along, elevation, limits, votes):  # type: ignore[no-untyped-def]
    z = elevation[rows]
    label = np.empty(len(rows), dtype=np.int8)
    for heading in (1, -1):
        for k in range(len(first) - 1):
            if first[k] < first[k + 1]:
                _walk(along, z, first[k], first[k + 1], heading, limits, label)
        for i in range(len(rows)):
            votes[rows[i]] += label[i]


@kernel
def _walk(along, z, begin, end, heading, limits, label):  # type: ignore[no-untyped-def]
    """Label one profile in one direction."""
    # The first points are likely ground, until the profile falls by more than the terrain can: then they were
    # on an object, and nothing is said of them. Where it has gone on for longer than any object, ground is
    # sure, that on the way there too.
    max_slope, step, max_object, _ = limits
    i = begin if heading > 0 else end - 1
    start, last = i, i
    on_ground, standing, slope = True, LIKELY, 0.0
    label[i] = LIKELY
    for _ in range(end - begin - 1):
        i += heading
        run = abs(along[i] - along[last])
        if on_ground and _rises(along, z, i, last, begin, end, heading, limits, label):
            on_ground = False
            label[i] = OBJECT
            continue
        if not on_ground and z[i] > z[last] + step + (max(slope, 0.0) + REENTRY_SLOPE) * run:
            label[i] = OBJECT
            if run > max_object:
                # No object is as long, or the longest was not known: unknown until it goes on as far again.
                label[i] = UNKNOWN
                start, last, on_ground, standing, slope = i, i, True, UNKNOWN, 0.0
            continue
        steepest = max_slope if on_ground else REENTRY_SLOPE + max(-slope, 0.0)
        if standing != GROUND and abs(along[i] - along[start]) > max_object:
            _replace_likely(label, start, i, heading, GROUND)
            standing = GROUND
        # By how much a profile has to fall until what came before was no ground.
        fall = max(FALL, steepest * run) if on_ground else FALL + steepest * run
        if standing != GROUND and z[last] - z[i] > fall:
            _replace_likely(label, start, i, heading, UNKNOWN)
            start, standing = i, LIKELY
        if on_ground:
            weight = min(1.0, run / SLOPE_MEMORY)
            slope += weight * ((z[i] - z[last]) / max(run, MIN_RUN) - slope)
            slope = min(max(slope, -MAX_TREND), MAX_TREND)
        label[i] = standing
        on_ground, last = True, i


@kernel
def _rises(along, z, i, last, begin, end, heading, limits, label):  # type: ignore[no-untyped-def]
    """Whether point i stands a step above the last ground point, or above one not much further back."""
    # In dense clouds a step spreads over several points; looking back over a fixed distance finds it all the
    # same.
    max_slope, step, _, window = limits
    j = last
    while begin <= j < end:
        run, rise = abs(along[i] - along[j]), z[i] - z[j]
        if run > window and j != last:
            return False
        if label[j] != OBJECT and rise > step and rise > max_slope * run:
            return True
        j -= heading
    return False


@inner_kernel
def _replace_likely(label, start, end, heading, after):  # type: ignore[no-untyped-def]
    i = start
    while i != end:
        if label[i] == LIKELY:
            label[i] = after
        i += heading


# Chosen with `bench.ground.isprs`.
#: How often points next to the ground are tried again, at most.
ROUNDS = 25
#: How far away a line through ground points may begin [multiples of the spacing].
REACH = 6.0
#: By how many lines ground has to lead to a point, more than half of those that lie well below it.
SUPPORT = 2
#: Points this near a line are where it leads to [m]; by how much that grows per unit of slope [m], and per
#: standard deviation of the ground.
TOLERANCE, TOLERANCE_SLOPE, ROUGHNESS = 0.2, 0.3, 1.0
#: Ground points on either side that a line is fitted to.
POINTS = 4
#: Steepest slope that is carried on beyond the points it was fitted to, rise over run.
MAX_SLOPE = 1.0
#: Roughness of the ground adds at most so much to the tolerance [m].
MAX_ROUGHNESS = 0.5
#: A point is against ground if it stands so many tolerances above the line; weights in half votes.
AGAINST = 3.0
FOR_WEIGHT, AGAINST_WEIGHT = 2, -1
#: Least mean square of the distances in which a slope can be seen [m²].
MIN_SPREAD = 0.05


def grow_ground(
    profiles: Sequence[Profiles], elevation: NDArray[np.float64], ground: NDArray[np.bool_], spacing: float
) -> NDArray[np.bool_]:
    """
    Return the ground with all points that lines through ground points beside them lead to.

    On every profile a line is fitted to the nearest ground points on either side of a point and carried on to
    it. A point joins where `SUPPORT` more lines lead to it than pass well below it, these counting half: at
    the foot and the top of a slope, one side of it always does. Repeated until no point joins. Profiles and
    elevations are those of `net_votes`, `ground` is what is known so far, `spacing` in [m].
    """
    ground = ground.copy()
    reach = REACH * spacing
    votes = np.zeros((len(profiles), len(ground)), dtype=np.int8)  # so few that their sum is no more
    axes = [_Axis(one, elevation, ground, votes[k]) for k, one in enumerate(profiles)]
    new = np.flatnonzero(ground)

    def judge(begin: int, end: int) -> None:
        for axis in axes[begin:end]:
            axis.judge(new, reach)

    for _ in range(ROUNDS):
        if not len(new):
            break
        for_row_blocks(judge, len(axes), 1)
        new = np.flatnonzero(~ground & (votes.sum(axis=0, dtype=np.int8) >= FOR_WEIGHT * SUPPORT))
        ground[new] = True
    return ground


class _Axis:
    """One set of profiles with the ground and the votes of its lines so far."""

    def __init__(
        self,
        profiles: Profiles,
        elevation: NDArray[np.float64],
        ground: NDArray[np.bool_],
        votes: NDArray[np.int8],
    ) -> None:
        self.profiles = profiles
        self.z = elevation[profiles.rows]
        self.ground = ground[profiles.rows]
        self.place = np.empty(len(self.z), dtype=np.intp)
        self.place[profiles.rows] = np.arange(len(self.z))
        self.line = np.repeat(np.arange(len(profiles.first) - 1), np.diff(profiles.first))
        #: Half votes for each row of the cloud.
        self.votes = votes

    def judge(self, new: NDArray[np.intp], reach: float) -> None:
        """Add new ground and count the lines again of all points within its reach."""
        one = self.profiles
        changed = self.place[new]
        self.ground[changed] = True
        stale = np.zeros(len(self.z), dtype=np.bool_)
        _mark_around(changed, one.along, self.line, self.ground, reach, stale)
        _judge(one.along, self.z, one.first, self.line, self.ground, stale, reach, one.rows, self.votes)


@kernel
def _mark_around(changed, along, line, ground, reach, stale):  # type: ignore[no-untyped-def]
    for i in changed:
        for heading in (-1, 1):
            j = i + heading
            while 0 <= j < len(along) and line[j] == line[i] and abs(along[j] - along[i]) <= reach:
                stale[j] = not ground[j]
                j += heading


@kernel
def _judge(along, z, first, line, ground, stale, reach, rows, votes):  # type: ignore[no-untyped-def]
    for i in range(len(rows)):
        if not stale[i]:
            continue
        vote = 0
        for heading in (-1, 1):
            begin, end = first[line[i]], first[line[i] + 1]
            is_line, height, slope, sigma = _line_beside(
                along, z, ground, i, heading, begin, end, np.int64(POINTS), reach
            )
            if not is_line:
                continue
            margin = TOLERANCE + TOLERANCE_SLOPE * abs(slope) + min(ROUGHNESS * sigma, MAX_ROUGHNESS)
            if height < margin:
                vote += FOR_WEIGHT
            elif height > AGAINST * margin:
                vote += AGAINST_WEIGHT
        votes[rows[i]] = vote


@kernel
def _line_beside(along, z, ground, i, heading, begin, end, n_points, reach):  # type: ignore[no-untyped-def]
    """Fit a line to the nearest ground points on one side of a profile's point i, −1 or 1, or on both, 0."""
    # Return whether there is one, the height of point i above it [m], its slope, which is no steeper than
    # `MAX_SLOPE` where it is carried on, and the standard deviation of the points [m].
    n, n_sides, st, sz, stt, stz, szz = 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for side in (-1, 1):
        before, j = n, i + side
        while begin <= j < end and n < before + n_points and abs(along[j] - along[i]) <= reach:
            if ground[j] and side * heading >= 0:
                t, dz = along[j] - along[i], z[j] - z[i]
                n += 1
                st, sz, stt, stz, szz = st + t, sz + dz, stt + t * t, stz + t * dz, szz + dz * dz
            j += side
        n_sides += 1 if n > before else 0
    wanted, spread = 2 - abs(heading), stt - st * st / max(n, 1)
    if n_sides < wanted or n <= wanted or spread < MIN_SPREAD * n:
        return False, 0.0, 0.0, 0.0
    slope = (stz - st * sz / n) / spread
    rest = max(szz - sz * sz / n - slope * (stz - st * sz / n), 0.0)
    if heading != 0:
        slope = min(max(slope, -MAX_SLOPE), MAX_SLOPE)
    return True, -(sz - slope * st) / n, slope, math.sqrt(rest / (n - 2)) if n > 2 else 0.0


# Chosen with `bench.ground.isprs`.
#: Ground is rejected that stands so many standard deviations above a line through its neighbours.
REJECTION = 2.0
#: Ground points on either side that a line is fitted to, and how far they may lie [multiples of the spacing].
REJECTION_POINTS, REJECTION_REACH = 6, 10.0
#: Sets of profiles that have to agree before a point is rejected, where there are as many.
MIN_AXES = 3


def reject_outliers(
    profiles: Sequence[Profiles],
    elevation: NDArray[np.float64],
    ground: NDArray[np.bool_],
    spacing: float,
    step: float,
) -> NDArray[np.bool_]:
    """
    Return the ground without the points that stand above it on every profile.

    The local linear regression of Shan & Sampath (2005): a line is fitted to the ground points on both sides,
    and a point is rejected if it lies further above it than the `step` [m] and than `REJECTION` times their
    standard deviation. Several profiles have to agree, so that ridges and the edges of terraces, which stand
    out on most, stay. The rest is that of `grow_ground`.
    """
    votes = np.zeros((len(profiles), len(ground)), dtype=np.int8)

    def judge(begin: int, end: int) -> None:
        for k in range(begin, end):
            one = profiles[k]
            rows, reach = one.rows, REJECTION_REACH * spacing
            _stand_out(one.along, elevation[rows], one.first, ground[rows], reach, step, rows, votes[k])

    for_row_blocks(judge, len(profiles), 1)
    n_judged = (votes != 0).sum(axis=0)
    return ground & ((n_judged < min(MIN_AXES, len(profiles))) | ((votes > 0).sum(axis=0) < n_judged))


@kernel
def _stand_out(along, z, first, ground, reach, step, rows, votes):  # type: ignore[no-untyped-def]
    """Vote on each point of the ground: 1 if it stands out, −1 if not, 0 without ground on both sides."""
    for k in range(len(first) - 1):
        begin, end = first[k], first[k + 1]
        for i in range(begin, end):
            if not ground[i]:
                continue
            is_line, height, _, sigma = _line_beside(
                along, z, ground, i, np.int64(0), begin, end, np.int64(REJECTION_POINTS), reach
            )
            if is_line:
                votes[rows[i]] = 1 if height > max(step, REJECTION * sigma) else -1


# Chosen with `bench.ground.isprs` where they matter; the first and the last have wide margins.
#: Fineness of the grid, and largest number of its cells, in all and to a point: they grow beyond.
CELLS_PER_RADIUS, MAX_CELLS, CELLS_PER_POINT, FEW_CELLS = 4.0, 4_000_000, 64, 100_000
#: Where there is no ground near, ground so many radii away says how the trend goes on, with little weight.
FAR, FAR_WEIGHT = 4.0, 1e-3
#: Weight of the mean of all, where there is none at all.
FLOOR = 1e-9


def fit_trend(points: NDArray[np.float64], ground: NDArray[np.bool_], radius: float) -> NDArray[np.float64]:
    """
    Return the elevation at each point of planes on a grid that are fitted to the ground points [m].

    Weights are Gaussian with a standard deviation of `radius` [m], so that all sums of all regressions come
    from smoothing grids of sums. At least one point is ground.
    """
    cell = radius / CELLS_PER_RADIUS
    low, high = extent_of(points)[:, :2]
    most = min(MAX_CELLS, max(CELLS_PER_POINT * len(points), FEW_CELLS))
    while np.prod((high - low) / cell + 3.0) > most:
        cell *= 2.0
    corner = (np.floor(low / cell) - 1.0) * cell
    columns, rows = (np.floor((high - corner) / cell) + 2.0).astype(int)
    x, y = (points[ground, :2] - corner).T
    base = points[:, 2].min()
    z = points[ground, 2] - base
    number = (y // cell).astype(np.intp) * columns + (x // cell).astype(np.intp)
    products = (np.ones(len(z)), x, y, z, x * x, x * y, y * y, x * z, y * z)
    moments = np.empty((len(products), rows, columns))

    def smooth(begin: int, end: int) -> None:
        for k in range(begin, end):
            sums = np.bincount(number, products[k], rows * columns).reshape(rows, columns).astype(np.float64)
            near, far = _blur(sums, radius / cell), _blur(sums, FAR * (radius / cell))
            moments[k] = near + FLOOR * sums.mean() + FAR_WEIGHT * far  # a little of what lies further away

    for_row_blocks(smooth, len(products), 1)
    middle_y, middle_x = (np.indices((rows, columns)) + 0.5) * cell
    elevation = base + _planes(moments, middle_x, middle_y, 0.1 * cell * cell)
    column, row = ((points[:, :2] - corner) / cell - 0.5).T
    return np.asarray(ndimage.map_coordinates(elevation, [row, column], order=1, mode="nearest"))


def _planes(
    moments: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64], level: float
) -> NDArray[np.float64]:
    """Return elevations at (x, y) of the planes of least squares, from sums of products."""
    # `level` is added to the variances in plan [m²]: points near one place, or on a line, have no slope
    # beyond.
    weight = np.maximum(moments[0], 1e-30)
    mx, my, mz, mxx, mxy, myy, mxz, myz = moments[1:] / weight
    xx, yy, xy = mxx - mx * mx + level, myy - my * my + level, mxy - mx * my
    xz, yz = mxz - mx * mz, myz - my * mz
    determinant = xx * yy - xy * xy
    slope_x, slope_y = (yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant
    return mz + slope_x * (x - mx) + slope_y * (y - my)


def _blur(values: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Smooth with nearly Gaussian weights: three moving means in turn; nothing lies beyond the grid."""
    # Three means over w cells have a variance of (w² - 1) / 4.
    width = max(round(math.sqrt(4.0 * sigma * sigma + 1.0)), 1)
    width += 1 - width % 2
    for _ in range(3):
        values = ndimage.uniform_filter(values, width, mode="constant")
    return values


#: Width of the strips from west to east that stand in for scan lines [spacings], as in `bidirectional_slope`.
STRIP_WIDTH = 1.7


def slope_pair_ground(
    points: NDArray[np.float64],
    free: NDArray[np.bool_],
    config: GroundFilterConfig,
    **scan: NDArray[Any] | None,
) -> NDArray[np.bool_]:
    """
    Tell which free points are ground by the 1D bi-directional slope filter (Sampath & Shan 2007, page 806).

    Along each scan line the filter looks for slopes between consecutive points steeper than
    `profile_max_slope`. Points from a rise on, up to a fall back to the elevation recorded before the rise,
    are no ground. Each line is filtered forth and back; what either pass calls no ground is none. Points,
    shape (n, 3), come in the scan's order [m]; `free` says which are no gross errors. `scan` has the columns
    that tell scan lines apart, see `find_scan_lines`; without any, strips from west to east are used.
    """
    rows = np.flatnonzero(free)
    spacing = quantised_spacing(points[rows])
    lines = find_scan_lines(points, spacing, **scan)
    if lines is None:
        profiles = cut_profiles(points[rows], STRIP_WIDTH * spacing, 0.0)
    else:
        profiles = lines.profiles(points, rows)
    limits = config.profile_max_slope, config.profile_step, config.profile_max_object
    own = rows[profiles.rows]
    ground = np.zeros(len(points), dtype=np.bool_)
    ground[own] = ~objects_between_slopes(profiles.along, points[own, 2], profiles.first, limits)
    return ground


@kernel
def objects_between_slopes(along, z, first, limits):  # type: ignore[no-untyped-def]
    """
    Return which points of profiles either pass finds between a rise and a fall.

    Limits are the slope, the distance from the recorded elevation [m], and the longest object [m].
    """
    is_object = np.zeros(len(z), dtype=np.bool_)
    for k in range(len(first) - 1):
        if first[k] < first[k + 1]:
            _walk_pairs(along, z, first[k], first[k + 1] - 1, 1, limits, is_object)
            _walk_pairs(along, z, first[k + 1] - 1, first[k], -1, limits, is_object)
    return is_object


@kernel
def _walk_pairs(along, z, start, end, heading, limits, is_object):  # type: ignore[no-untyped-def]
    """Mark what one pass finds; `ground` is the last ground point, whose elevation is recorded."""
    max_slope, tolerance, longest = limits
    ground, is_inside, i = start, False, start
    while i != end:
        before, i = i, i + heading
        slope = (z[i] - z[before]) / max(abs(along[i] - along[before]), MIN_RUN)
        run = abs(along[i] - along[ground])
        if is_inside:
            back = slope < -max_slope and z[i] <= z[ground] + tolerance + REENTRY_SLOPE * run
            is_inside = not back and run <= longest
        else:
            is_inside = slope > max_slope
        if is_inside:
            is_object[i] = True
        else:
            ground = i
