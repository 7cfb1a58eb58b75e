"""Concavities of a traced ring that are gaps between points, bridged before walls are sought."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.stages.regularisation.config import RegularisationConfig

#: Depth and length of a concavity up to which it is where scan lines happen to end [spacings].
_MAX_DEPTH, _MAX_LENGTH = 1.0, 12.0
#: Area of a gap up to which it is left by chance [spacings²], and its depth [spacings].
_MAX_GAP_AREA = 3.0

#: A ring keeps at least so many vertices.
_FEWEST = 4
#: Where the bridged ring turns inwards by more, a bridge cuts a corner of the building [rad].
_CORNER_TURN = np.deg2rad(25.0)
#: Size of the concavities that are bridged at first, and beside corners [limits].
_SIZES = (1.0, 0.6)


class ConcavityLimits(NamedTuple):
    """Up to where a concavity is none of the building's."""

    #: Up to these it is what a row of points looks like whose scan lines end anywhere [m].
    depth: float
    length: float
    #: A gap no larger than that may be left empty by chance, however deep it is, up to `gap_depth` [m²].
    area: float
    gap_depth: float  #: depth of the deepest such gap [m]


def concavity_limits(config: RegularisationConfig, spacing: float) -> ConcavityLimits | None:
    """Return which concavities are bridged at a point spacing [m]; None if none are."""
    if not config.bridge_concavities:
        return None
    return ConcavityLimits(
        _MAX_DEPTH * spacing, _MAX_LENGTH * spacing, _MAX_GAP_AREA * spacing**2, _MAX_GAP_AREA * spacing
    )


def bearing_points(ring: NDArray[np.float64], limits: ConcavityLimits) -> NDArray[np.bool_]:
    """
    Mark the vertices that bear a ring: all but those in concavities that are gaps between points.

    Points are scattered inside a wall, none outside: a ring dips inwards between those that happen to lie
    near it, and a line through all vertices runs inside the wall by a third of a spacing or more. A concavity
    is bridged if it is shallow, or so small that points leave its area empty by chance, and if the ring goes
    straight on beside it: otherwise it is a re-entrant corner. All points stay inside the ring, which has the
    building on its left; at least four are marked, if there are so many.
    """
    return np.asarray(_bridged(np.ascontiguousarray(ring), *map(float, limits)))


@kernel
def _bridged(ring, depth, length, area, gap_depth):  # type: ignore[no-untyped-def]
    """Bridge all concavities; take out bridges that cut corners and bridge only smaller ones there."""
    bears = np.ones(len(ring), dtype=np.bool_)
    for size in _SIZES:
        following, preceding = _bridge(
            ring, bears, size * depth, size * length, size * size * area, size * gap_depth
        )
        if not _open_corners(ring, bears, following, preceding):
            break
    return bears


@kernel
def _bridge(ring, bears, depth, length, area, gap_depth):  # type: ignore[no-untyped-def]
    """
    Take vertices out of the ring, always those whose concavity is the shallowest round about.

    Where the ring starts has no say: only vertices shallower than both their neighbours go in one sweep.
    """
    n = len(ring)
    rows, left = np.empty(n, dtype=np.int64), 0
    for i in range(n):
        if bears[i]:
            rows[left] = i
            left += 1
    rows = rows[:left]
    following, preceding = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    removal = np.full(n, np.inf)
    for k in range(left):
        following[rows[k]], preceding[rows[k]] = rows[(k + 1) % left], rows[k - 1]
    for i in rows:
        removal[i] = _removal_depth(ring, preceding[i], following[i], depth, length, area, gap_depth)
    changed = True
    while changed and left > _FEWEST:
        changed = False
        for i in rows:
            first, last = preceding[i], following[i]
            is_next = bears[i] and removal[i] < removal[first] and removal[i] <= removal[last]
            if not is_next or left <= _FEWEST:
                continue
            bears[i], removal[i] = False, np.inf
            following[first], preceding[last] = last, first
            for k in (first, last):
                removal[k] = _removal_depth(ring, preceding[k], following[k], depth, length, area, gap_depth)
            left -= 1
            changed = True
    return following, preceding


@kernel
def _open_corners(ring, bears, following, preceding):  # type: ignore[no-untyped-def]
    """Take out the bridges beside points at which the ring turns inwards; return whether there were any."""
    opened, bore = False, bears.copy()
    for i in range(len(bears)):
        if not bore[i]:
            continue
        first, last = preceding[i], following[i]
        ax, ay = ring[i, 0] - ring[first, 0], ring[i, 1] - ring[first, 1]
        bx, by = ring[last, 0] - ring[i, 0], ring[last, 1] - ring[i, 1]
        if np.arctan2(ay * bx - ax * by, ax * bx + ay * by) > _CORNER_TURN:
            opened |= _open(bears, first, i)
            opened |= _open(bears, i, last)
    return opened


@kernel
def _open(bears, first, last):  # type: ignore[no-untyped-def]
    """Give the ring back what lies under a bridge; return whether it was one."""
    n, opened = len(bears), False
    i = first + 1 if first + 1 < n else 0
    while i != last:
        opened |= not bears[i]
        bears[i] = True
        i = i + 1 if i + 1 < n else 0
    return opened


@kernel
def _removal_depth(ring, first, last, depth, length, area, gap_depth):  # type: ignore[no-untyped-def]
    """Return the depth of the concavity between two vertices, infinite if it has to stay."""
    chord, deepest, hollow = _concavity(ring, first, last)
    if (deepest <= depth and chord <= length) or (hollow <= area and deepest <= gap_depth):
        return deepest
    return np.inf


@kernel
def _concavity(ring, first, last):  # type: ignore[no-untyped-def]
    """
    Return chord, depth and area of what lies between two vertices; infinite depth if it is no concavity.

    A concavity lies on the left of its chord and its vertices stand between the chord's ends.
    """
    n = len(ring)
    x, y = ring[first]
    dx, dy = ring[last, 0] - x, ring[last, 1] - y
    chord = np.hypot(dx, dy)
    if chord == 0:
        return 0.0, np.inf, np.inf
    deepest, doubled = 0.0, 0.0
    last_along, last_depth = 0.0, 0.0
    i = first + 1 if first + 1 < n else 0
    while i != last:
        along = (dx * (ring[i, 0] - x) + dy * (ring[i, 1] - y)) / chord
        inside = (dx * (ring[i, 1] - y) - dy * (ring[i, 0] - x)) / chord
        if inside <= 0 or along < 0 or along > chord:
            return chord, np.inf, np.inf
        deepest = max(deepest, inside)
        doubled += along * last_depth - last_along * inside
        last_along, last_depth = along, inside
        i = i + 1 if i + 1 < n else 0
    doubled += chord * last_depth
    return chord, deepest, 0.5 * abs(doubled)
