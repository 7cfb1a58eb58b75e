"""How well edge labels agree with the alpha shapes of roofs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lidar_buildings.core.model.point_array import checked_column, checked_points
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.edge_labelling.rims import on_rims
from lidar_buildings.evaluation.scores.roofs import roof_rows
from lidar_buildings.evaluation.scores.statistics import Confusion, confusion_of

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
