"""The peer to beat: vertical planes fitted to points of walls by RANSAC (Fischler & Bolles 1981)."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import KDTree

#: Points are thinned to one per voxel of this size; on a plane they lie within that of it [m].
VOXEL, ON_PLANE = 0.2, 0.05
#: A try looks at points up to here from its first one; a plane ends where no point lies for so long [m].
NEAR, GAP = 4.0, 1.0
#: Planes hold so many points, and so many a metre, and are so long at least; points this near a plane are
#: used up [m].
MIN_POINTS, MIN_DENSITY, MIN_LENGTH, USED = 20, 12.0, 0.75, 0.15
#: Tries for each plane, and planes that fail before the search ends.
N_TRIES, N_FAILURES = 40, 40


def vertical_planes(points: NDArray[np.float64], seed: int = 0) -> list[shapely.LineString]:
    """Return the lines in plan of vertical planes through points, shape (n, 3) [m]; best ones first."""
    random = np.random.default_rng(seed)
    _, first = np.unique(np.floor(points / VOXEL).astype(np.int64), axis=0, return_index=True)
    xy = points[first, :2]
    found: list[shapely.LineString] = []
    failures, tree = 0, KDTree(xy)
    while failures < N_FAILURES and len(xy) > MIN_POINTS:
        near = np.array(tree.query_ball_point(xy[random.integers(len(xy))], NEAR))
        line = _best_line(xy[near], random) if len(near) > MIN_POINTS else None
        run = None if line is None else _longest_run(xy, *line)
        if run is None:
            failures += 1
            continue
        failures = 0
        found.append(shapely.LineString(run))
        xy = xy[shapely.distance(found[-1], shapely.points(xy)) > USED]
        tree = KDTree(xy)
    return found


def _best_line(
    xy: NDArray[np.float64], random: np.random.Generator
) -> tuple[NDArray[np.float64], ...] | None:
    """A place on the line through two points that has most points on it, and its direction."""
    pairs = xy[random.integers(len(xy), size=(N_TRIES, 2))]
    span = pairs[:, 1] - pairs[:, 0]
    length = np.hypot(*span.T)
    pairs, along = pairs[length > MIN_LENGTH], (span / np.maximum(length, 1e-9)[:, None])[length > MIN_LENGTH]
    if not len(pairs):
        return None
    arm = xy[None] - pairs[:, :1]
    off = np.abs(arm[..., 0] * along[:, None, 1] - arm[..., 1] * along[:, None, 0])
    best = int((off < ON_PLANE).sum(axis=1).argmax())
    return _fitted(xy[off[best] < ON_PLANE])


def _fitted(xy: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The middle of points and the direction in which they spread most."""
    middle = xy.mean(axis=0)
    _, vectors = np.linalg.eigh(np.cov((xy - middle).T))
    return middle, vectors[:, 1]


def _longest_run(
    xy: NDArray[np.float64], place: NDArray[np.float64], along: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Ends of the longest stretch without a gap of the line through points near it; None if it is short."""
    for _ in range(2):
        off = np.abs((xy - place) @ np.array([-along[1], along[0]]))
        on = xy[off < ON_PLANE]
        at = np.sort((on - place) @ along)
        runs = np.split(at, np.flatnonzero(np.diff(at) > GAP) + 1)
        run = max(runs, key=len)
        if np.ptp(run) < MIN_LENGTH or len(run) < max(MIN_POINTS, MIN_DENSITY * np.ptp(run)):
            return None
        inside = ((on - place) @ along >= run[0]) & ((on - place) @ along <= run[-1])
        ends = place + run[[0, -1], None] * along
        place, along = _fitted(on[inside])
    return place + ((ends - place) @ along)[:, None] * along
