"""A traced ring as weighted samples: every metre of it counts alike, however the points are spread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.regularisation.concavities import ConcavityLimits, bearing_points
from lidar_buildings.core.stages.regularisation.config import RegularisationConfig

#: Longest piece of a bridge between two bearing points that gets no sample of its own [spacings].
_LONGEST_PIECE = 2.0
#: Weight of a point that is repeated: next to none, since there is no ring between the two.
_LEAST_WEIGHT = 1e-6
#: Length that one sample of weight 1 stands for: the median edge of a traced ring [spacings].
SAMPLE_LENGTH = 1.98
#: What each bearing point leaves empty between itself and the wall, measured on virtual roofs [spacings²].
_EMPTY_AREA = 0.55


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
    """
    Return how far bearing points lie inside the edge [m]: the area that each leaves empty over its length.
    """
    length = sum(ring.length for ring in samples)
    n_bearing = sum(int(ring.bears.sum()) for ring in samples)
    return _EMPTY_AREA * spacing**2 * n_bearing / length if length > 0 else 0.0


def _depths(ring: NDArray[np.float64], rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """
    Return how far the points of a ring lie inside the bridges between those in `rows`, shape (n_points,) [m].
    """
    corners = ring[rows]
    along = np.roll(corners, -1, axis=0) - corners
    along /= np.maximum(np.hypot(*along.T), 1e-12)[:, None]
    bridge = np.searchsorted(rows, np.arange(len(ring)), side="right") - 1
    dx, dy = (ring - corners[bridge]).T
    return np.asarray(along[bridge, 0] * dy - along[bridge, 1] * dx)
