"""
What speaks against a model: how its points, and the lack of them, contradict it.

What counts is the share of the outline's area on which the model may be wrong, whatever for. Lengths are in
spacings where it is the sampling that limits what is known.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from scipy.spatial import cKDTree

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.grade import Cause, Doubt, Grade
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid, face_plane
from lidar_buildings.core.stages.building_model.quality import EMPTY, OFF, OFF_HEIGHT, ROUGH, Support
from lidar_buildings.core.stages.building_model.result import RoofFacePatch

#: Finest level of detail.
_FINEST = "2.2"
#: Around a wall points are so many times as far away as around a spot inside: there are none behind it.
_ONE_SIDED = 1.45
#: Points are as far apart as this at least, also where many lie on one another [spacings].
_LEAST_GAP = 0.1
#: A traced outline lies within so much of where the roof ends, mostly inside it [spacings].
_UNSURE = 0.4
#: An outline is too wide if on so much of its length the points end farther within it than expected, by so
#: much more.
_ALL_ROUND, _WIDE = 0.7, 0.25
#: Of so many points next to one that is off, half are as far off, but for this [m], if all are a detail; so
#: much of all that are off has to be.
_NEXT, _ALIKE, _MOSTLY = 4, 0.25, 0.4
#: A wall is looked at in so many steps a spacing, all walls in so many together, whatever the spacing is; so
#: many spots tell how far points are apart.
_STEPS, _MOST_STEPS, _MOST_SPOTS = 2.0, 100_000, 200
#: So many points around a corner, those nearer than this [spacings] alone, say how high it may be.
_AROUND, _REACH = 64, 3.0
#: What rises or sinks more than this beyond them, besides what its slope does over so much, is a spike [m],
#: [spacings].
_SPIKE, _SLOPE_REACH = 1.2, 1.5


class Evidence(NamedTuple):
    """What was measured, as shares of the outline's area; heights in metres."""

    off: float  #: the points near are off the model, as one surface
    rough: float  #: they are off here and there
    detail: float  #: share of the points that are off together with those next to them, as those of a rim
    empty: float  #: no point is near
    wide: float  #: the outline goes on beyond the outermost points, all round; else 0
    #: How far these lie within it, 0 on the outline, 1 as far as where points are scattered on either side.
    margin: float
    unsure: float  #: the strip in which a traced outline may lie
    spike: float  #: how far the highest corner rises, or the lowest sinks, beyond all points near [m]


def evidence_of(
    faces: Sequence[RoofFacePatch], points: FloatArray, outline: Outline, spacing: float, support: Support
) -> Evidence:
    """Measure what speaks against the roof faces of a model over an outline."""
    tree = cKDTree(points[:, :2], compact_nodes=False, balanced_tree=False)
    spots = support.spots
    inside, _ = tree.query(spots[:: len(spots) // _MOST_SPOTS + 1])
    expected = max(_ONE_SIDED * float(np.median(inside)), _LEAST_GAP * spacing)
    walls = ring_walls([ring for ring in outline.rings if len(ring) >= 3])
    length = np.hypot(*(walls[:, 1] - walls[:, 0]).T)
    mean, middle = _gaps(tree, walls, length, spacing)
    area = max(outline.area, spacing**2)
    excess = middle - expected
    is_wide = length[excess > _WIDE * expected].sum() > _ALL_ROUND * length.sum()
    return Evidence(
        off=support.share(support.state == OFF),
        rough=support.share(support.state == ROUGH),
        detail=_detail(tree, points, support.above),
        empty=support.share(support.state == EMPTY),
        wide=float((excess * length).sum()) / area if is_wide else 0.0,
        margin=float((mean * length).sum() / (expected * length.sum())),
        unsure=_UNSURE * spacing * float(length.sum()) / area,
        spike=_spike(tree, points, faces, spacing),
    )


def _detail(tree: cKDTree, points: FloatArray, above: FloatArray) -> float:
    off = np.flatnonzero(np.abs(above) > OFF_HEIGHT)
    if not len(off) or len(points) <= _NEXT:
        return 0.0
    _, beside = tree.query(points[off, :2], k=_NEXT + 1)
    alike = np.abs(above[beside[:, 1:]] - above[off][:, None]) < _ALIKE
    n_alike = int(np.count_nonzero(np.count_nonzero(alike, axis=1) >= _NEXT // 2))
    return n_alike / len(points) if n_alike > _MOSTLY * len(off) else 0.0  # in noise some are by chance


def _gaps(
    tree: cKDTree, walls: FloatArray, length: FloatArray, spacing: float
) -> tuple[FloatArray, FloatArray]:
    """Return the mean and the median distance of each wall to the nearest point."""
    often = min(_STEPS / spacing, _MOST_STEPS / float(length.sum()))
    n = np.maximum(length * often, 1.0).astype(np.int64)
    wall = np.repeat(np.arange(len(walls)), n)
    first = np.cumsum(n) - n
    step = (np.arange(len(wall)) - first[wall] + 0.5) / n[wall]
    gap, _ = tree.query(walls[wall, 0] + step[:, None] * (walls[wall, 1] - walls[wall, 0]))
    return np.bincount(wall, gap) / n, gap[np.lexsort((gap, wall))][first + n // 2]


def _spike(tree: cKDTree, points: FloatArray, faces: Sequence[RoofFacePatch], spacing: float) -> float:
    corners = np.concatenate([ring for face in faces for ring in face.rings])
    plane = np.repeat([face.plane for face in faces], [sum(map(len, face.rings)) for face in faces], axis=0)
    z = np.einsum("ij,ij->i", plane[:, :2], corners) + plane[:, 2]
    slack = np.hypot(*plane[:, :2].T) * spacing * _SLOPE_REACH
    far, row = tree.query(corners, k=min(_AROUND, len(points)), distance_upper_bound=_REACH * spacing)
    far, row = far.reshape(len(corners), -1), row.reshape(len(corners), -1)
    is_near = np.isfinite(far)
    known = is_near.any(axis=1)
    near = points[np.where(is_near, row, 0), 2]
    high, low = np.where(is_near, near, -np.inf).max(axis=1), np.where(is_near, near, np.inf).min(axis=1)
    beyond = np.maximum(z - high, low - z)[known] - slack[known]
    return float(beyond.max(initial=0.0))


def level_doubts(lod: str, has_extent: bool = True) -> Iterator[Doubt]:
    """Yield what a coarse level of detail says."""
    if lod != _FINEST:
        grade = Grade.CHECK if has_extent else Grade.POOR
        yield Doubt(Cause.COARSE_LEVEL, f"LoD{lod} is the finest level", grade)


#: Shares of the outline's area from which on a model is doubtful, chosen with `bench.models.grades`. Most
#: roofs of which a quarter has no points are right all the same, so that only larger gaps count.
_MOST_OFF, _MOST_DETAIL, _MOST_ROUGH, _MOST_EMPTY = 0.015, 0.02, 0.05, 0.3
_MOST_WIDE, _MOST_BESIDE, _MOST_UNSURE = 0.045, 0.02, 0.0545
#: The share from which on it is poor.
_POOR = 0.25
#: The outermost points lie on traced outlines, nearer than this, see `Evidence.margin`.
_TRACED_MARGIN = 0.85


def doubts_of(evidence: Evidence, is_traced: bool | None = None) -> Iterator[Doubt]:
    """Yield what the evidence says; if it is not known whether an outline is traced, its margin tells."""
    e = evidence
    if e.off > _MOST_OFF or e.detail > _MOST_DETAIL:
        yield _doubt(Cause.OFF_POINTS, max(e.off, e.detail), "of the roof is more than 0.5 m off its points")
    if e.rough > _MOST_ROUGH:
        yield _doubt(Cause.SCATTERED, e.rough, "of the roof has points scattered about it")
    if e.empty > _MOST_EMPTY:
        yield _doubt(Cause.NO_POINTS, e.empty, "of the outline has no points", 0.5)
    if e.wide > _MOST_WIDE:
        yield _doubt(Cause.TOO_WIDE, e.wide, "of the outline lies beyond the points, all round")
    if e.spike > _SPIKE:
        yield Doubt(Cause.SPIKE, f"a corner lies {e.spike:.1f} m beyond all points near")
    if is_traced is None:
        is_traced = e.margin < _TRACED_MARGIN
    if is_traced and e.unsure > _MOST_UNSURE:
        yield _doubt(Cause.SPARSE, e.unsure, "of the outline's area may be wrong: points are far apart", 1.0)


def _doubt(cause: Cause, share: float, text: str, poor: float = _POOR) -> Doubt:
    return Doubt(cause, f"{share:.0%} {text}", Grade.POOR if share > poor else Grade.CHECK)


#: Points of roofs that no footprint has are of this one if they are so near to it [m], and so near to the
#: plane of its roof there [m].
BESIDE, _ON_PLANE = 2.0, 0.3
#: Walls are drawn so far beside where they stand, and points lie so far beyond them [m].
_DRAWN = 0.2


def beside_doubts(
    outline: Outline, solid: Solid | None, beside: FloatArray, spacing: float | None
) -> Iterator[Doubt]:
    """Yield a doubt where roof points beside a footprint, in none, go on as its roof does."""
    if solid is None or not len(beside) or not spacing or outline.area <= 0.0:
        return
    places = shapely.points(beside[:, :2])
    away = shapely.distance(outline.polygon, places)
    near = (away > _DRAWN) & (away < BESIDE)
    beside, places = beside[near], places[near]
    if len(beside) * spacing**2 <= _MOST_BESIDE * outline.area:
        return
    faces = [
        solid.face_rings(face)
        for face, kind in zip(solid.faces, solid.semantics, strict=True)
        if kind == ROOF_SURFACE
    ]
    planes = np.array([face_plane(rings) or (0.0, 0.0, np.inf) for rings in faces])
    areas = np.array(
        [shapely.Polygon(outer[:, :2], [hole[:, :2] for hole in holes]) for outer, *holes in faces]
    )
    own = planes[np.argmin(shapely.distance(areas[:, None], places), axis=0)]
    on = np.abs(np.einsum("ij,ij->i", own[:, :2], beside[:, :2]) + own[:, 2] - beside[:, 2]) < _ON_PLANE
    share = int(np.count_nonzero(on)) * spacing**2 / outline.area
    if share > _MOST_BESIDE:
        yield _doubt(Cause.TOO_NARROW, share, "of its area goes on beside the footprint")
