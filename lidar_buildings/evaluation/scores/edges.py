"""Edges of roofs: those of a reference by alpha shapes, and the score of those labelled."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from lidar_buildings.core.model.point_array import checked_column, checked_points
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.edge_labelling.rims import on_rims
from lidar_buildings.core.stages.footprints.footprints import last_polygon_around
from lidar_buildings.core.surfaces.surface_patches import connected_parts
from lidar_buildings.evaluation.scores.cells import Confusion, confusion_of

#: Smaller parts of a reference's class are noise, not roofs: as small as a run drops them [m²].
MIN_ROOF_AREA = 6.0
#: What a point of no roof has in place of a number.
NO_ROOF = -1


def fewest_points(spacing: float) -> int:
    """Return how many points of this spacing [m] the smallest roof has."""
    return math.ceil(MIN_ROOF_AREA / spacing**2)


def roofs_of_polygons(points: ArrayLike, polygons: ArrayLike) -> NDArray[np.int64]:
    """
    Return the row of the polygon that each point lies in or on, of several the first; −1 for none.

    There is one geometry a roof or block; invalid ones are repaired.
    """
    valid = shapely.make_valid(np.atleast_1d(np.asarray(polygons, dtype=object)))
    # From the last to the first, so that the first one stays.
    found = last_polygon_around(np.asarray(points, dtype=np.float64)[:, :2], valid[::-1])
    return np.where(found >= 0, len(valid) - 1 - found.astype(np.int64), NO_ROOF)


def roofs_of_points(points: ArrayLike, gap: float, *, min_points: int = 1) -> NDArray[np.int64]:
    """
    Number the parts of a cloud that are connected in plan, from west to east; −1 for too small ones.

    Points no further apart than `gap` belong together. Numbers follow the parts' westernmost points, of as
    western ones the southernmost.
    """
    cloud = checked_points(points)
    part = connected_parts(cloud, gap, in_plan=True)
    is_small = np.bincount(part, minlength=1)[part] < min_points if len(part) else np.zeros(0, dtype=bool)
    return _from_the_west(cloud, np.where(is_small, NO_ROOF, part))


def split_at_steps(
    points: ArrayLike, roof: ArrayLike, gap: float, *, min_points: int = 1
) -> NDArray[np.int64]:
    """
    Split each roof into parts between which the surface steps, so that a step is an edge of the upper part.

    Points no further apart than `gap` in space belong together. Smaller parts than `min_points` (chimneys,
    dormers, noise) stay with the nearest larger part of their roof in plan; a roof without a larger one stays
    whole.
    """
    cloud = checked_points(points)
    given = checked_column("roof", roof, len(cloud), np.int64)
    found = np.full(len(cloud), NO_ROOF, dtype=np.int64)
    n_parts = 0
    for rows in roof_rows(given):
        part = _merged_into_large(cloud[rows], connected_parts(cloud[rows], gap), min_points)
        found[rows] = n_parts + part
        n_parts += int(part.max()) + 1
    return _from_the_west(cloud, found)


def roof_rows(roof: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return the rows of each roof's points, by rising number; those of negative numbers are left out."""
    order = np.argsort(roof, kind="stable").astype(np.int64)
    order = order[np.searchsorted(roof[order], 0) :]
    starts = np.flatnonzero(np.diff(roof[order])) + 1
    return [rows for rows in np.split(order, starts) if len(rows)]


def _merged_into_large(
    points: NDArray[np.float64], part: NDArray[np.int64], min_points: int
) -> NDArray[np.int64]:
    """Give points of small parts to the part of the nearest point in plan that is of a large one."""
    large = np.bincount(part)[part] >= min_points
    if not large.any():
        return np.zeros_like(part)
    if large.all():
        return part
    # Of several as near, the first by x, y, z: the order of the points has no say.
    rows = np.flatnonzero(large)
    rows = rows[np.lexsort(points[rows].T[::-1])]
    nearest = cKDTree(points[rows, :2]).query(points[~large, :2])[1]
    merged = part.copy()
    merged[~large] = part[rows[nearest]]
    return merged


def _from_the_west(points: NDArray[np.float64], label: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number labels anew by their westernmost points, then by y, then z; negative ones become −1."""
    order = np.lexsort(points.T[::-1])
    order = order[label[order] >= 0]
    labels, first = np.unique(label[order], return_index=True)
    number = np.full(int(label.max(initial=-1)) + 2, NO_ROOF, dtype=np.int64)
    number[labels] = np.argsort(np.argsort(first))
    # The last entry is that of the negative ones.
    return number[np.maximum(label, -1)]


#: Radius of the disc by which Santos, Galo and others found their reference [m], and the density of their
#: cloud [points/m²]: elsewhere the radius is as many point spacings, 1.342.
PAPER_ALPHA, PAPER_DENSITY = 0.60, 5.0


@dataclass(frozen=True)
class EdgeScore:
    """Agreement of two labellings of roof points, edge or not; a share of nothing is NaN."""

    n_points: int  #: points that count
    #: Edge points among them.
    n_edges_reference: int
    n_edges_result: int
    #: Edges in both / in the reference, / in the result, and the harmonic mean.
    edge_completeness: float
    edge_correctness: float
    edge_f_score: float
    #: The same of the points on no edge.
    non_edge_completeness: float
    non_edge_correctness: float
    non_edge_f_score: float


def alpha_of_spacing(spacing: float) -> float:
    """Return the radius that is to the spacing as 0.60 m is to that of 5 points/m² [m]."""
    return PAPER_ALPHA * math.sqrt(PAPER_DENSITY) * spacing


def reference_edges(points: ArrayLike, roof: ArrayLike, alpha: float) -> NDArray[np.bool_]:
    """
    Return the points that lie on the alpha shape of their roof (Santos, Galo and others, section 2.4).

    Those are the points that an empty disc can touch in plan (Edelsbrunner, Kirkpatrick & Seidel 1983:
    *alpha-extreme*). They write the disc's radius as −1/α, later authors as √α; here alpha is the radius [m].
    A negative number of a roof is none, and its points are no edges.
    """
    cloud = checked_points(points)
    number = checked_column("roof", roof, len(cloud), np.int64)
    # Points of no roof make up a roof of their own, which the others do not see.
    every = np.ones(len(cloud), dtype=np.bool_)
    edge = on_rims(sort_by_cell(cloud, 2.0 * alpha), every, number, radius=alpha, reach=0.0)
    return edge & (number >= 0)


def score_edges(result: ArrayLike, reference: ArrayLike) -> EdgeScore:
    """Compare the labels of the same points, edge or not; ValueError if the lengths differ."""
    edge = confusion_of(result, reference)
    other = Confusion(edge.rejections, edge.misses, edge.false_alarms, edge.hits)
    return EdgeScore(
        n_points=edge.total,
        n_edges_reference=edge.hits + edge.misses,
        n_edges_result=edge.hits + edge.false_alarms,
        edge_completeness=edge.recall,
        edge_correctness=edge.precision,
        edge_f_score=edge.f1,
        non_edge_completeness=other.recall,
        non_edge_correctness=other.precision,
        non_edge_f_score=other.f1,
    )


def score_edges_per_roof(
    result: ArrayLike, reference: ArrayLike, roof: ArrayLike, n_roofs: int
) -> list[EdgeScore]:
    """Compare the labels roof by roof; points of negative roofs do not count, one without has no figures."""
    mine, theirs = np.asarray(result, dtype=bool), np.asarray(reference, dtype=bool)
    number = checked_column("roof", roof, len(mine), np.int64)
    rows_of = {int(number[rows[0]]): rows for rows in roof_rows(number)}
    none = np.zeros(0, dtype=np.int64)
    return [score_edges(mine[rows], theirs[rows]) for rows in (rows_of.get(k, none) for k in range(n_roofs))]
