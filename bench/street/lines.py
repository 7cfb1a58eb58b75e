"""Wall lines beside true ones: which length is found, right, and how near."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

#: Lines are compared at places this far apart [m].
STEP = 0.1
#: A line is near another one only where they run the same way within this angle.
MAX_TURN_DEG = 30.0


class Places(NamedTuple):
    """Places along lines."""

    xy: NDArray[np.float64]  #: shape (n, 2) [m]
    direction: NDArray[np.float64]  #: unit vectors of the lines there
    length: NDArray[np.float64]  #: for which each stands [m]
    line: NDArray[np.int64]  #: row of the line

    @property
    def total(self) -> float:
        """Length of all lines [m]."""
        return float(self.length.sum())


def segments_of(lines: Iterable[shapely.Geometry]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the straight pieces of lines, shape (n, 2, 2) [m], and the row of the line of each."""
    pieces, rows = [], []
    for row, line in enumerate(lines):
        for part in shapely.get_parts(line):
            xy = shapely.get_coordinates(part)
            pieces.append(np.stack([xy[:-1], xy[1:]], axis=1))
            rows.append(np.full(len(xy) - 1, row))
    if not pieces:
        return np.empty((0, 2, 2)), np.empty(0, dtype=np.int64)
    segments, row = np.concatenate(pieces), np.concatenate(rows)
    is_long = np.hypot(*(segments[:, 1] - segments[:, 0]).T) > 1e-6
    return segments[is_long], row[is_long]


def places_along(lines: Iterable[shapely.Geometry]) -> Places:
    """Return places in the middle of steps of about `STEP`."""
    segments, row = segments_of(lines)
    span = segments[:, 1] - segments[:, 0]
    length = np.hypot(*span.T)
    count = np.maximum(np.rint(length / STEP).astype(np.int64), 1)
    of = np.repeat(np.arange(len(segments)), count)
    place = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    share = (place + 0.5) / count[of]
    xy = segments[of, 0] + share[:, None] * span[of]
    return Places(xy, (span / length[:, None])[of], (length / count)[of], row[of])


def offsets_to(
    places: Places,
    lines: Sequence[shapely.Geometry],
    reach: float,
    max_turn_deg: float = MAX_TURN_DEG,
) -> NDArray[np.float64]:
    """Distance from each place to the nearest line that runs the same way, ∞ beyond `reach` [m]."""
    offset = np.full(len(places.xy), np.inf)
    segments, _ = segments_of(lines)
    if not len(segments) or not len(offset):
        return offset
    span = segments[:, 1] - segments[:, 0]
    along = span / np.hypot(*span.T)[:, None]
    pieces = shapely.linestrings(segments)
    points = shapely.points(places.xy)
    place, piece = shapely.STRtree(pieces).query(points, predicate="dwithin", distance=reach)
    same = (
        np.abs((places.direction[place] * along[piece]).sum(axis=1))
        >= np.cos(np.deg2rad(max_turn_deg)) - 1e-9
    )
    place, piece = place[same], piece[same]
    np.minimum.at(offset, place, shapely.distance(points[place], pieces[piece]))
    return offset


def share_within(places: Places, offset: NDArray[np.float64], tolerance: float) -> float:
    """Share of the length that lies so near; NaN of nothing."""
    return float(places.length[offset <= tolerance].sum() / places.total) if places.total else np.nan


class WallScore(NamedTuple):
    """How well wall lines are found."""

    true_length: float  #: of true walls that were seen [m]
    found_length: float  #: of lines that are called seen [m]
    assumed_length: float  #: of all other lines [m]
    completeness: float  #: share of the true length with a line called seen within the tolerance
    correctness: float  #: share of the found length within the tolerance of any true wall
    honesty: float  #: the same within 0.1 m, whatever the tolerance
    rmse: float  #: of the distances of found lines within 0.3 m of a true wall [m]


#: A line is honest within this, and of a wall at all within that [m].
HONEST, OF_A_WALL = 0.1, 0.3


def wall_score(
    found: Sequence[shapely.Geometry],
    assumed: Sequence[shapely.Geometry],
    seen: Sequence[shapely.Geometry],
    walls: Sequence[shapely.Geometry],
    tolerance: float,
) -> WallScore:
    """Compare lines called seen, and those that are assumed, with walls that were seen, and all walls."""
    reach = max(tolerance, OF_A_WALL)
    truth, own = places_along(seen), places_along(found)
    offset = offsets_to(own, walls, reach)
    near = offset <= OF_A_WALL
    rmse = np.sqrt(np.average(offset[near] ** 2, weights=own.length[near])) if near.any() else np.nan
    return WallScore(
        truth.total,
        own.total,
        places_along(assumed).total,
        share_within(truth, offsets_to(truth, found, reach), tolerance),
        share_within(own, offset, tolerance),
        share_within(own, offset, HONEST),
        float(rmse),
    )
