"""How well the corners, edges and ridges of roofs agree with a reference's."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidar_buildings.evaluation.scores.corners import match_corners
from lidar_buildings.evaluation.scores.polygons import spots_along
from lidar_buildings.evaluation.scores.statistics import mean, percentile, ratio, root_mean_square
from lidar_buildings.evaluation.scores.wireframe import Wireframe

#: Lines whose directions differ by more are not the same [deg].
MAX_TURN_DEG = 15.0
#: Edges are looked at this often along their length [m]: finer than any tolerance.
_STEP = 0.25
#: So many near spots of the other side are asked for their direction.
_N_NEAR = 12


@dataclass(frozen=True)
class WireframeScore:
    """Agreement of two wireframes, see `doc/scores.md`; a share or mean of nothing is NaN."""

    n_corners_result: int
    n_corners_reference: int
    n_corners_matched: int
    corner_precision: float
    corner_recall: float
    corner_f1: float
    corner_offset: float
    n_edges_result: int
    n_edges_reference: int
    n_edges_matched: int
    edge_precision: float
    edge_recall: float
    edge_f1: float
    edge_length_precision: float
    edge_length_recall: float


def score_wireframes(result: Wireframe, reference: Wireframe, tolerance: float) -> WireframeScore:
    """
    Match corners one to one, as many as possible and then as near as possible, and edges by their ends.

    As the Building3D benchmark does (Wang, Huang & Yang 2023), with a tolerance in metres. ValueError if that
    is not a positive number.
    """
    if not (math.isfinite(tolerance) and tolerance > 0):
        raise ValueError(f"tolerance = {tolerance}: must be a length above 0")
    mine, theirs, distance = match_corners(result.corners, reference.corners, tolerance)
    n_mine, n_theirs = len(result.corners), len(reference.corners)
    n_edges = _n_common_edges(result, reference, mine, theirs)
    return WireframeScore(
        n_corners_result=n_mine,
        n_corners_reference=n_theirs,
        n_corners_matched=len(mine),
        corner_precision=ratio(len(mine), n_mine),
        corner_recall=ratio(len(mine), n_theirs),
        corner_f1=ratio(2 * len(mine), n_mine + n_theirs),
        corner_offset=mean(distance),
        n_edges_result=len(result.edges),
        n_edges_reference=len(reference.edges),
        n_edges_matched=n_edges,
        edge_precision=ratio(n_edges, len(result.edges)),
        edge_recall=ratio(n_edges, len(reference.edges)),
        edge_f1=ratio(2 * n_edges, len(result.edges) + len(reference.edges)),
        edge_length_precision=_share_followed(result.segments, reference.segments, tolerance),
        edge_length_recall=_share_followed(reference.segments, result.segments, tolerance),
    )


def _n_common_edges(
    result: Wireframe, reference: Wireframe, mine: NDArray[np.int64], theirs: NDArray[np.int64]
) -> int:
    """Count the edges of the result whose partners in the reference are joined, too."""
    partner = np.full(len(result.corners), -1, dtype=np.int64)
    partner[mine] = theirs
    wanted = {(min(i, j), max(i, j)) for i, j in reference.edges.tolist()}
    return sum((min(i, j), max(i, j)) in wanted for i, j in partner[result.edges].tolist())


def _share_followed(edges: NDArray[np.float64], others: NDArray[np.float64], tolerance: float) -> float:
    """Return the share of the edges' length within the tolerance of another edge of about their direction."""
    spots, directions, weights = _spots(edges)
    if not len(spots):
        return math.nan
    other_spots, other_directions, _ = _spots(others)
    if not len(other_spots):
        return 0.0
    reach = math.hypot(tolerance, _STEP / 2)
    near = cKDTree(other_spots).query(spots, k=_N_NEAR, distance_upper_bound=reach)[1]
    is_there = near < len(other_spots)
    beside = other_directions[np.where(is_there, near, 0)]
    cosine = np.abs(np.einsum("ikj,ij->ik", beside, directions))
    followed = (is_there & (cosine > math.cos(math.radians(MAX_TURN_DEG)))).any(axis=1)
    return ratio(float(weights[followed].sum()), float(weights.sum()))


def _spots(
    edges: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return spots along edges, their directions, and the length that each stands for [m]."""
    row, spots = spots_along(edges, _STEP)
    vectors = edges[:, 1] - edges[:, 0]
    lengths = np.linalg.norm(vectors, axis=1)
    return spots, (vectors / lengths[:, None])[row], (lengths / np.bincount(row))[row]


@dataclass(frozen=True)
class RidgeScore:
    """Agreement of ridges, see `doc/scores.md`; a share or mean of nothing is NaN."""

    n_reference: int
    recall: float
    bias: float
    rmse: float
    largest: float


def score_ridges(result: Wireframe, reference: Wireframe, tolerance: float) -> RidgeScore:
    """Compare the elevation of each ridge with that of the nearest ridge of the result, in plan."""
    ridges = reference.segments[reference.is_ridge]
    errors = ridge_errors(result.segments[result.is_ridge], ridges, tolerance)
    found = errors[np.isfinite(errors)]
    return RidgeScore(
        n_reference=len(ridges),
        recall=ratio(len(found), len(ridges)),
        bias=mean(found),
        rmse=root_mean_square(found),
        largest=percentile(np.abs(found), 100),
    )


def ridge_errors(
    result: NDArray[np.float64], reference: NDArray[np.float64], tolerance: float
) -> NDArray[np.float64]:
    """
    Return how much too high the result's ridge is at the middle of each of the reference's [m], NaN if none.
    """
    errors = np.full(len(reference), np.nan)
    if not len(result):
        return errors
    vectors = result[:, 1] - result[:, 0]
    squared = (vectors[:, :2] ** 2).sum(axis=1)
    for row, (start, end) in enumerate(reference):
        middle, along = (start + end) / 2, end[:2] - start[:2]
        share = np.clip(((middle - result[:, 0])[:, :2] * vectors[:, :2]).sum(axis=1) / squared, 0.0, 1.0)
        foot = result[:, 0] + share[:, None] * vectors
        distance = np.hypot(*(foot - middle)[:, :2].T)
        cosine = np.abs(vectors[:, :2] @ along) / np.sqrt(squared * (along @ along))
        distance[cosine < math.cos(math.radians(MAX_TURN_DEG))] = np.inf
        nearest = int(np.argmin(distance))
        if distance[nearest] <= tolerance:
            errors[row] = foot[nearest, 2] - middle[2]
    return errors
