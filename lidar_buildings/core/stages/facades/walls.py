"""
Walls as all points near them tell: pieces of one line joined, fitted to points, ended where these end.

And what was seen before, behind and over them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import CellGrid, rows_by_cell
from lidar_buildings.core.stages.facades.curves import Curve, fit_curve
from lidar_buildings.core.stages.facades.pieces import Piece

Floats = NDArray[np.float64]

#: Side of the cells by which points are found [m].
POINT_CELL = 1.0
#: Side of the cells that tell what was seen of a place [m].
PLACE_CELL = 0.5
_BESIDE = np.array([(i, k) for k in (-1, 0, 1) for i in (-1, 0, 1)])
#: Least noise from which a fit starts: more if the pieces are rougher [m].
NOISE = 0.04
#: Points within so many σ of a wall are on it, and the fit looks at them; of a wall at least within this [m].
ON_SIGMAS, MIN_ON = 3.0, 0.04
#: Two lines are fitted where they part by this and by σ at least, each as long as a house's front [m], and
#: leave so much of the squares of offsets at most.
MIN_STEP, MIN_SIDE, STEP_GAIN = 0.04, 4.0, 0.6
#: Length of a bin, and its points from which it was seen [m].
BIN, SEEN_POINTS = 0.25, 5
#: Pieces whose ends lie within this of a line are of it [m], and a little more per metre between them.
SAME_LINE, SAME_ANGLE = 0.05, 0.02
#: Pieces of a line farther apart are not joined [m].
JOIN_GAP = 6.0


class _Cells:
    """Cells of a plan grid that hold something, to be found by their places."""

    def __init__(self, points: Floats, size: float) -> None:
        self.grid: CellGrid = rows_by_cell(points, size)
        corner = np.zeros(2)
        if len(points):
            corner = np.floor(self.grid.points[0, :2] / self.grid.size) - self.grid.places[0, ::-1]
        self._corner = corner.astype(np.int64)

    def at(self, xy: Floats) -> NDArray[np.int64]:
        """Return column and row of positions, shape (n, 2)."""
        return np.floor(xy / self.grid.size).astype(np.int64) - self._corner

    def held(self, cells: NDArray[np.int64]) -> NDArray[np.intp]:
        """Return which cell of the grid each is, −1 where nothing lies."""
        if not len(self.grid.numbers):
            return np.full(len(cells), -1, dtype=np.intp)
        number = cells[:, 1] * self.grid.n_columns + cells[:, 0]
        found = np.minimum(np.searchsorted(self.grid.numbers, number), len(self.grid.numbers) - 1)
        known = (self.grid.numbers[found] == number) & (cells[:, 0] >= 0)
        known &= cells[:, 0] < self.grid.n_columns
        return np.where(known, found, -1)


class PointsAbout:
    """The points of a cloud that may be of walls."""

    def __init__(self, points: Floats, height: Floats, is_core: NDArray[np.bool_]) -> None:
        self._cells = _Cells(points, POINT_CELL)
        rows = self._cells.grid.rows
        self.points = self._cells.grid.points
        self.height, self.is_core = height[rows], is_core[rows]

    def near(self, curve: Curve, first: float, last: float, reach: float) -> tuple[NDArray[np.intp], Floats]:
        """Return the points within reach (≤ 1 m) of a stretch of a curve: rows, and places on it."""
        steps = np.linspace(first, last, int(np.ceil((last - first) / (0.5 * POINT_CELL))) + 2)
        cells = (self._cells.at(curve.at(steps))[:, None] + _BESIDE).reshape(-1, 2)
        held = np.unique(self._cells.held(cells))
        held = held[held >= 0]
        starts = self._cells.grid.first
        runs = [np.arange(starts[k], starts[k + 1]) for k in held]
        rows = np.concatenate(runs) if runs else np.zeros(0, dtype=np.intp)
        place, offset = curve.seen_from(self.points[rows, :2])
        near = (place >= first) & (place <= last) & (np.abs(offset) <= reach)
        return rows[near], place[near]


class Scenery:
    """Whether ground was seen at a place, and how high above ground what else was."""

    def __init__(self, ground: Floats, others: Floats, height: Floats) -> None:
        self.ground = ground  #: places on it, one a cell [m], shape (n, 3)
        self._ground, self._others = _Cells(ground, PLACE_CELL), _Cells(others, PLACE_CELL)
        grid = self._others.grid
        begins = grid.first[:-1]
        own = height[grid.rows]
        self._highest = np.maximum.reduceat(own, begins) if len(begins) else np.zeros(0)

    def along(self, curve: Curve, place: Floats, across: Floats) -> tuple[NDArray[np.bool_], Floats]:
        """
        Return whether ground was seen, and the height of what is highest above ground, −inf where nothing.

        Both of shape (n_places, n_across): at so many places along the curve, so far on its left [m].
        """
        at = curve.at(place)[:, None] + across[None, :, None] * curve.normals_at(place)[:, None]
        shape, at = at.shape[:2], at.reshape(-1, 2)
        is_ground = self._ground.held(self._ground.at(at)) >= 0
        held = self._others.held(self._others.at(at))
        highest = np.full(len(held), -np.inf)
        highest[held >= 0] = self._highest[held[held >= 0]]
        return is_ground.reshape(shape), highest.reshape(shape)


@dataclass(frozen=True, eq=False)
class Wall:
    """A stretch of a curve along which points on it were seen."""

    curve: Curve
    sigma: float  #: of the points on it [m]
    first: float  #: places on the curve where it begins and ends [m]
    last: float
    rows: NDArray[np.intp]  #: of the points on it, among those of `PointsAbout`
    place: Floats  #: of each on the curve [m]
    is_seen: NDArray[np.bool_]  #: bin by bin from `first` on

    @property
    def length(self) -> float:
        """Length along the curve [m]."""
        return self.last - self.first

    @property
    def bins(self) -> NDArray[np.intp]:
        """In which bin each point is."""
        share = (self.place - self.first) / max(self.length, 1e-9)
        n = len(self.is_seen)
        return np.clip((share * n).astype(np.intp), 0, n - 1)

    @property
    def middles(self) -> Floats:
        """Places of the bins' middles [m]."""
        n = len(self.is_seen)
        return np.asarray(self.first + (np.arange(n) + 0.5) * (self.length / n))

    def reversed(self) -> Wall:
        """Return the wall run through the other way."""
        return Wall(
            self.curve.reversed(),
            self.sigma,
            -self.last,
            -self.first,
            self.rows,
            -self.place,
            self.is_seen[::-1],
        )


def joined_walls(pieces: Sequence[Piece], around: PointsAbout, max_gap: float) -> list[Wall]:
    """Join the pieces of each line, fit them to all points, and end them where too few points lie."""
    left, walls = list(pieces), list[Wall]()
    while left:
        group, left = _of_one_line(left)
        walls += _fitted(group, around, max_gap)
    return walls


def _of_one_line(pieces: Sequence[Piece]) -> tuple[list[Piece], list[Piece]]:
    """Part the pieces that go on the first one's curve from the others."""
    group, left = [pieces[0]], list(pieces[1:])
    curve = pieces[0].curve
    first, last = pieces[0].first, pieces[0].last
    grown = True
    while grown:
        grown, rest = False, []
        for one in left:
            ends = one.curve.at(np.array([one.first, 0.5 * (one.first + one.last), one.last]))
            place, offset = curve.seen_from(ends)
            gap = max(first - place.max(), place.min() - last, 0.0)
            if gap <= JOIN_GAP and np.abs(offset).max() <= SAME_LINE + SAME_ANGLE * min(gap, 1.0):
                group.append(one)
                first, last = min(first, place.min()), max(last, place.max())
                grown = True
            else:
                rest.append(one)
        left = rest
    return group, left


def _fitted(group: Sequence[Piece], around: PointsAbout, max_gap: float) -> Iterator[Wall]:
    curve = group[0].curve
    ends = np.array([curve.seen_from(one.curve.at(np.array([one.first, one.last])))[0] for one in group])
    spans = np.sort(ends, axis=1)
    first, last = spans.min(), spans.max()
    noise = max(NOISE, float(np.median([one.roughness for one in group])))
    rows, place = around.near(curve, first, last, ON_SIGMAS * noise)
    in_span = np.zeros(len(rows), dtype=bool)
    for low, high in spans:
        in_span |= (place >= low) & (place <= high)
    if np.count_nonzero(in_span) >= SEEN_POINTS:
        yield from _through(around.points[rows[in_span], :2], curve, noise, around, max_gap)


def _through(xy: Floats, curve: Curve, noise: float, around: PointsAbout, max_gap: float) -> Iterator[Wall]:
    """Yield the walls on a curve through positions near it, or on several where these go on beside it."""
    place, _ = curve.seen_from(xy)
    first, last = place.min(), place.max()
    # near the scanner points are many: a bin counts as the root of what it has
    bins = np.floor((place - first) / BIN).astype(np.int64)
    fitted, sigma = fit_curve(xy, curve, noise, 1.0 / np.sqrt(np.bincount(bins)[bins]))
    if not fitted.bend:
        place, offset = fitted.seen_from(xy)
        cut = _step(place, offset, max(MIN_STEP, sigma))
        if np.isfinite(cut):
            for own in (place < cut, place >= cut):
                yield from _through(xy[own], fitted, noise, around, max_gap)
            return
    near = max(ON_SIGMAS * sigma, MIN_ON)
    # in the middle of the stretch, so that the cut through a circle lies opposite
    middle = curve.at(np.array([0.5 * (first + last)]))
    fitted = fitted.begun_at(float(fitted.seen_from(middle)[0][0]))
    half = min(0.5 * (last - first) + BIN, fitted.half_length)
    rows, place = around.near(fitted, -half, half, near)
    for begin, end, is_seen in _runs(place, max_gap):
        own = (place >= begin) & (place <= end)
        yield Wall(fitted, sigma, begin, end, rows[own], place[own], is_seen)


def _step(place: Floats, offset: Floats, min_step: float) -> float:
    """
    Return where positions along a line go on beside it, as fronts of neighbouring houses do, else NaN.

    Two lines through the medians of bins, one up to there and one from there on, leave far less than one.
    """
    bins = np.floor((place - place.min()) / BIN).astype(np.int64)
    order = np.lexsort((offset, bins))
    first = np.flatnonzero(np.diff(bins[order], prepend=-1))
    count = np.diff(np.append(first, len(order)))
    is_seen = count >= SEEN_POINTS
    medians = offset[order][first + count // 2][is_seen]
    at = BIN * (bins[order][first][is_seen] + 0.5)
    n_side = round(MIN_SIDE / BIN)
    cuts = np.arange(n_side, len(at) - n_side + 1)
    if not len(cuts):
        return np.nan
    (left, ends), (right, begins) = _lines_up_to(at, medians), _lines_up_to(-at[::-1], medians[::-1])
    whole, parted = left[-1], left[cuts - 1] + right[::-1][cuts]
    jump = np.abs(ends[cuts - 1] - begins[::-1][cuts])
    parted = np.where(jump >= min_step, parted, np.inf)
    best = int(np.argmin(parted))
    if parted[best] > STEP_GAIN * whole:
        return np.nan
    return float(place.min() + 0.5 * (at[cuts[best] - 1] + at[cuts[best]]))


def _lines_up_to(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return the squares that a line through the first k + 1 positions leaves, and its value at the last."""
    n = np.arange(1, len(x) + 1)
    x = x - x[0]
    sx, sy, sxx, sxy, syy = (np.cumsum(one) for one in (x, y, x * x, x * y, y * y))
    var, cov = sxx - sx * sx / n, sxy - sx * sy / n
    slope = np.divide(cov, var, out=np.zeros(len(x)), where=var > 1e-9)
    return np.maximum(syy - sy * sy / n - slope * cov, 0.0), sy / n + slope * (x - sx / n)


def _runs(place: Floats, max_gap: float) -> Iterator[tuple[float, float, NDArray[np.bool_]]]:
    """Yield from where to where points lie close enough, and which bins of it were seen."""
    if not len(place):
        return
    ordered = np.sort(place)
    # a place is seen if as many points lie within a bin about it
    ahead = np.searchsorted(ordered, ordered + BIN, side="right") - np.arange(len(ordered)) >= SEEN_POINTS
    is_in = np.zeros(len(ordered), dtype=bool)
    starts = np.flatnonzero(ahead)
    counts = np.zeros(len(ordered) + 1, dtype=np.int64)
    np.add.at(counts, starts, 1)
    np.add.at(counts, np.searchsorted(ordered, ordered[starts] + BIN, side="right"), -1)
    is_in = np.cumsum(counts[:-1]) > 0
    kept = ordered[is_in]
    if not len(kept):
        return
    for run in np.split(kept, np.flatnonzero(np.diff(kept) > max_gap) + 1):
        length = max(run[-1] - run[0], 1e-9)
        n_bins = max(1, round(length / BIN))
        bins = np.minimum(((run - run[0]) / length * n_bins).astype(np.int64), n_bins - 1)
        filled = np.bincount(bins, minlength=n_bins)
        yield float(run[0]), float(run[-1]), filled >= SEEN_POINTS
