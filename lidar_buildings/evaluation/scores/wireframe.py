"""The wireframe of a roof: its visible corners and edges, however a model divides its surfaces."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid
from lidar_buildings.evaluation.scores.roof_surfaces import unit_normal

#: Faces that meet at a smaller angle are one surface, and edges that turn by less are one line [deg].
MIN_FOLD_DEG = 1.0
#: A ridge is level but for so much [deg]; wide margin: a hip of a 30° roof rises by 22°.
MAX_RIDGE_SLOPE_DEG = 5.0
#: Corners closer than this are one [m]: the grid on which models are written.
SAME_CORNER = 1e-3

#: Two corners by their numbers, the smaller first.
Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Wireframe:
    """Corners and the straight edges between them."""

    corners: NDArray[np.float64]  #: where edges end or turn [m], shape (n_corners, 3)
    edges: NDArray[np.int64]  #: rows of the corners, shape (n_edges, 2)
    #: Whether the roof falls to both sides of an edge that is level, shape (n_edges,).
    is_ridge: NDArray[np.bool_]

    @property
    def segments(self) -> NDArray[np.float64]:
        """The ends of each edge, shape (n_edges, 2, 3) [m]."""
        return self.corners[self.edges]


class _Side(NamedTuple):
    """What lies along one directed edge: its face's kind and normal, and its direction."""

    is_roof: bool
    normal: NDArray[np.float64]
    along: NDArray[np.float64]


def roof_wireframe(solids: Iterable[Solid]) -> Wireframe:
    """
    Return the ridges, hips, valleys, eaves and step edges of roofs, each line of them once.

    An edge is one of a roof face behind which the surface folds by a degree or more; what only parts one
    plane into several faces is none. Consecutive edges on a straight line are one. Solids that share an edge,
    as touching houses do, have it in common.
    """
    rows: dict[tuple[int, ...], int] = {}
    edges: dict[Pair, bool] = {}
    for solid in solids:
        for (i, j), is_ridge in _folds(solid).items():
            ends = sorted(_number(solid.vertices[k], rows) for k in (i, j))
            if ends[0] != ends[1]:
                pair = ends[0], ends[1]
                edges[pair] = edges.get(pair, True) and is_ridge
    corners = np.array(list(rows), dtype=np.float64).reshape(-1, 3) * SAME_CORNER
    return _compacted(corners, _straightened(corners, edges))


def n_corners(solid: Solid) -> int:
    """Count the corners of a whole solid: vertices at which three surfaces or more meet."""
    frame = _straightened(solid.vertices, dict.fromkeys(_folds(solid, of_roofs=False), False))
    return len({end for pair in frame for end in pair})


def _number(vertex: NDArray[np.float64], rows: dict[tuple[int, ...], int]) -> int:
    """Return a corner's number, a new one where there was none."""
    return rows.setdefault(tuple(np.rint(vertex / SAME_CORNER).astype(np.int64).tolist()), len(rows))


def _folds(solid: Solid, *, of_roofs: bool = True) -> dict[Pair, bool]:
    """Return the edges at which a solid's surface folds, and whether they are ridges."""
    sides: dict[Pair, list[_Side]] = defaultdict(list)
    for face, kind in zip(solid.faces, solid.semantics, strict=True):
        normal = unit_normal(solid.vertices[list(face[0])])
        for ring in face:
            for i, j in zip(ring, ring[1:] + ring[:1], strict=True):
                along = solid.vertices[j] - solid.vertices[i]
                sides[min(i, j), max(i, j)].append(_Side(kind == ROOF_SURFACE, normal, along))
    return {
        pair: _is_ridge(around)
        for pair, around in sides.items()
        if (not of_roofs or any(side.is_roof for side in around)) and _is_fold(around)
    }


def _is_fold(sides: Sequence[_Side]) -> bool:
    if len(sides) == 1:
        return True
    cosine = min(float(sides[0].normal @ side.normal) for side in sides[1:])
    return cosine < math.cos(math.radians(MIN_FOLD_DEG))


def _is_ridge(sides: Sequence[_Side]) -> bool:
    """Whether two roof faces fall away from a level edge."""
    if len(sides) != 2 or not all(side.is_roof for side in sides):
        return False
    along = sides[0].along
    if abs(along[2]) > math.tan(math.radians(MAX_RIDGE_SLOPE_DEG)) * math.hypot(along[0], along[1]):
        return False
    # A face lies to the left of its edge; its upward normal leans to where it falls.
    return all(float(side.normal[:2] @ (-side.along[1], side.along[0])) > 0 for side in sides)


def _straightened(corners: NDArray[np.float64], edges: dict[Pair, bool]) -> dict[Pair, bool]:
    """Join edges that continue one another where no other edge ends."""
    kept = dict(edges)
    around: dict[int, set[int]] = defaultdict(set)
    for i, j in edges:
        around[i].add(j)
        around[j].add(i)
    for corner in sorted(around):
        if len(around[corner]) != 2:
            continue
        one, other = sorted(around[corner])
        if other in around[one] or not _is_straight(corners[[one, corner, other]]):
            continue
        flags = [kept.pop((min(corner, end), max(corner, end))) for end in (one, other)]
        kept[one, other] = all(flags)
        for end, next_end in ((one, other), (other, one)):
            around[end] = around[end] - {corner} | {next_end}
        around[corner] = set()
    return kept


def _is_straight(ends: NDArray[np.float64]) -> bool:
    before, after = ends[1] - ends[0], ends[2] - ends[1]
    lengths = float(np.linalg.norm(before) * np.linalg.norm(after))
    return float(before @ after) > math.cos(math.radians(MIN_FOLD_DEG)) * lengths


def _compacted(corners: NDArray[np.float64], edges: dict[Pair, bool]) -> Wireframe:
    """Leave out corners that no edge ends at."""
    pairs = np.array(list(edges), dtype=np.int64).reshape(-1, 2)
    used, rows = np.unique(pairs, return_inverse=True)
    ridges = np.array(list(edges.values()), dtype=bool)
    return Wireframe(corners[used], rows.reshape(-1, 2).astype(np.int64), ridges)
