"""A traced ring as weighted samples: gaps between points are bridged, and every metre counts alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.outline import Outline
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
#: Longest piece of a bridge between two bearing points that gets no sample of its own [spacings].
_LONGEST_PIECE = 2.0
#: Weight of a point that is repeated: next to none, since there is no ring between the two.
_LEAST_WEIGHT = 1e-6
#: Length that one sample of weight 1 stands for: the median edge of a traced ring [spacings].
SAMPLE_LENGTH = 1.98
#: What each bearing point leaves empty between itself and the wall, measured on virtual roofs [spacings²].
_EMPTY_AREA = 0.55


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
    """Take vertices out of the ring, those of the shallowest concavity round about, in sweeps."""
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
    """Return chord, depth and area between two vertices; infinite depth if that is no concavity."""
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


@dataclass(frozen=True, eq=False)
class RingSamples:
    """The samples that walls are fitted to."""

    #: The bearing points of the ring and, evenly spread, points of the long bridges between them [m], shape
    #: (n_samples, 2).
    points: NDArray[np.float64]
    #: Share of the ring that each stands for [`SAMPLE_LENGTH` spacings], shape (n_samples,).
    weights: NDArray[np.float64]
    bears: NDArray[np.bool_]  #: whether a sample is a point of the ring, shape (n_samples,)
    #: Row of `ring` of each sample, or of the bearing point before it, shape (n_samples,).
    rows: NDArray[np.int64]
    ring: NDArray[np.float64]  #: all points of the ring [m], shape (n_points, 2)
    #: Whether a point of the ring lies on a wall: it bears one, or lies in a concavity no deeper than points
    #: of one wall are scattered, shape (n_points,).
    is_on_wall: NDArray[np.bool_]

    @property
    def on_walls(self) -> NDArray[np.float64]:
        """The points of the ring that lie on walls, shape (n_on_walls, 2) [m]."""
        return self.ring[self.is_on_wall]

    @property
    def length(self) -> float:
        """Length of the ring of bearing points [m]."""
        return float(np.hypot(*(np.roll(self.points, -1, axis=0) - self.points).T).sum())


def sample_ring(ring: NDArray[np.float64], spacing: float, limits: ConcavityLimits | None) -> RingSamples:
    """
    Bridge the concavities of a ring, the building on its left, and spread samples along what is left.

    Without limits every point of the ring is a sample of weight 1.
    """
    if limits is None:
        every = np.ones(len(ring), dtype=bool)
        return RingSamples(ring, np.ones(len(ring)), every, np.arange(len(ring)), ring, every)
    rows = np.flatnonzero(bearing_points(ring, limits))
    corners = ring[rows]
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(*edges.T)
    is_bridge = np.diff(rows, append=rows[0] + len(ring)) > 1
    n_pieces = np.where(is_bridge, np.ceil(lengths / (_LONGEST_PIECE * spacing)), 1.0)
    pieces = np.maximum(n_pieces, 1.0).astype(np.int64)
    edge = np.repeat(np.arange(len(corners)), pieces)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    points = corners[edge] + edges[edge] * (step / pieces[edge])[:, None]
    piece = (lengths / pieces)[edge]
    weights = 0.5 * (piece + np.roll(piece, 1)) / (SAMPLE_LENGTH * spacing)
    np.maximum(weights, _LEAST_WEIGHT, out=weights)
    is_on_wall = _depths(ring, rows) <= limits.depth
    return RingSamples(points, weights, step == 0, rows[edge], ring, is_on_wall)


def working_spacing(traced: Outline, config: RegularisationConfig) -> float:
    """Return the point spacing, made larger by how well points are placed at best [m]."""
    return float(np.hypot(ring_spacing(traced), config.finest_spacing))


def ring_spacing(traced: Outline) -> float:
    """Return the point spacing that a traced outline's edges speak of [m]."""
    edges = [np.hypot(*(np.roll(ring, -1, axis=0) - ring).T) for ring in traced.rings]
    return float(np.median(np.concatenate(edges))) / SAMPLE_LENGTH


def estimated_bias(samples: list[RingSamples], spacing: float) -> float:
    """Return how far bearing points lie inside the edge [m]: the area each leaves empty by its length."""
    length = sum(ring.length for ring in samples)
    n_bearing = sum(int(ring.bears.sum()) for ring in samples)
    return _EMPTY_AREA * spacing**2 * n_bearing / length if length > 0 else 0.0


def _depths(ring: NDArray[np.float64], rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return how far a ring's points lie inside the bridges between `rows`, shape (n_points,) [m]."""
    corners = ring[rows]
    along = np.roll(corners, -1, axis=0) - corners
    along /= np.maximum(np.hypot(*along.T), 1e-12)[:, None]
    bridge = np.searchsorted(rows, np.arange(len(ring)), side="right") - 1
    dx, dy = (ring - corners[bridge]).T
    return np.asarray(along[bridge, 0] * dy - along[bridge, 1] * dx)
