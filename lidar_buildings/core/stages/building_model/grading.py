"""
What speaks against a model: how its points, and the lack of them, contradict it.

What counts is the share of the outline's area on which the model may be wrong, whatever for. Lengths are in
spacings where it is the sampling that limits what is known.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely
from scipy import ndimage
from scipy.spatial import cKDTree

from lidar_buildings.core.model.array_types import FloatArray
from lidar_buildings.core.model.grade import Cause, Doubt, Grade
from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid, face_plane
from lidar_buildings.core.stages.building_model.quality import EMPTY, OFF_HEIGHT, ROUGH, Support

#: Finest level of detail.
_FINEST = "2.2"
#: A traced outline lies so far within where the roof ends, since points are scattered [spacings].
_UNSURE = 1.0 / 3.0
#: A patch is where the points, by their median, lie farther than this off the roof on one side of it [m].
_PATCH_HEIGHT = 0.25
#: Of so many points next to one that is off, half are as far off, but for this [m], if all are a detail; so
#: much of all that are off has to be.
_NEXT, _ALIKE, _MOSTLY = 4, 0.25, 0.4


class Evidence(NamedTuple):
    """What was measured, as shares of the outline's area."""

    patch: float  #: the largest patch on which the points lie off the roof, all above or all below
    rough: float  #: the points near are off the model, scattered
    detail: float  #: share of the points that are off together with those next to them, as those of a rim
    empty: float  #: no point is near
    unsure: float  #: the strip in which a traced outline may lie


def evidence_of(points: FloatArray, outline: Outline, spacing: float, support: Support) -> Evidence:
    """Measure what speaks against the roof of a model over an outline."""
    walls = ring_walls([ring for ring in outline.rings if len(ring) >= 3])
    length = float(np.hypot(*(walls[:, 1] - walls[:, 0]).T).sum())
    return Evidence(
        patch=max(_largest_patch(support, support.middle), _largest_patch(support, -support.middle)),
        rough=support.share(support.state == ROUGH),
        detail=_detail(points, support.above),
        empty=support.share(support.state == EMPTY),
        unsure=_UNSURE * spacing * length / max(outline.area, spacing**2),
    )


def _largest_patch(support: Support, above: FloatArray) -> float:
    patches, n = ndimage.label(above > _PATCH_HEIGHT)
    return support.share(patches == np.bincount(patches.ravel())[1:].argmax() + 1) if n else 0.0


def _detail(points: FloatArray, above: FloatArray) -> float:
    off = np.flatnonzero(np.abs(above) > OFF_HEIGHT)
    if not len(off) or len(points) <= _NEXT:
        return 0.0
    tree = cKDTree(points[:, :2], compact_nodes=False, balanced_tree=False)
    _, beside = tree.query(points[off, :2], k=_NEXT + 1)
    alike = np.abs(above[beside[:, 1:]] - above[off][:, None]) < _ALIKE
    n_alike = int(np.count_nonzero(np.count_nonzero(alike, axis=1) >= _NEXT // 2))
    return n_alike / len(points) if n_alike > _MOSTLY * len(off) else 0.0  # in noise some are by chance


def level_doubts(lod: str, has_extent: bool = True) -> Iterator[Doubt]:
    """Yield what a coarse level of detail says."""
    if lod != _FINEST:
        grade = Grade.CHECK if has_extent else Grade.POOR
        yield Doubt(Cause.COARSE_LEVEL, f"LoD{lod} is the finest level", grade)


#: Shares from which on a model is doubtful, chosen with `bench.models.grades`. Most roofs of which a half has
#: no points are right all the same: planes go on.
_MOST_PATCH, _MOST_DETAIL, _MOST_ROUGH, _MOST_EMPTY = 0.05, 0.01, 0.075, 0.5
_MOST_UNSURE, _MOST_GROUND, _MOST_BESIDE = 0.04, 0.03, 0.02
#: The share from which on it is poor.
_POOR = 0.25


def doubts_of(evidence: Evidence, is_traced: bool) -> Iterator[Doubt]:
    """Yield what the evidence says of a model on a traced outline or on another one."""
    e = evidence
    if e.patch > _MOST_PATCH or e.detail > _MOST_DETAIL:
        text = f"of the roof lies more than {_PATCH_HEIGHT:g} m off its points, in one piece"
        yield _doubt(Cause.OFF_POINTS, max(e.patch, e.detail), text)
    if e.rough > _MOST_ROUGH:
        yield _doubt(Cause.SCATTERED, e.rough, "of the roof has points scattered about it")
    if e.empty > _MOST_EMPTY:
        yield _doubt(Cause.NO_POINTS, e.empty, "of the outline has no points")
    if is_traced and e.unsure > _MOST_UNSURE:
        text = "of the outline's area may be missing along its walls: points are far apart"
        yield _doubt(Cause.SPARSE, e.unsure, text, 1.0)


def _doubt(cause: Cause, share: float, text: str, poor: float = _POOR) -> Doubt:
    return Doubt(cause, f"{share:.0%} {text}", Grade.POOR if share > poor else Grade.CHECK)


def ground_doubts(n_ground: int, n_points: int) -> Iterator[Doubt]:
    """Yield a doubt where many of the points on a footprint are of the ground: there is no roof."""
    share = n_ground / max(n_ground + n_points, 1)
    if share > _MOST_GROUND:
        yield _doubt(Cause.ON_GROUND, share, "of the points on the footprint are of the ground")


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
