"""How high the ridges of roofs are, compared with a reference's."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.evaluation.scores.statistics import ratio
from lidar_buildings.evaluation.scores.wireframe import Wireframe
from lidar_buildings.evaluation.scores.wireframe_match import MAX_TURN_DEG


@dataclass(frozen=True)
class RidgeScore:
    """
    Agreement of ridges; a share or mean of nothing is NaN.

    Attributes
    ----------
    n_reference : int
        Ridges of the reference.
    recall : float
        Share of them beside which the result has a ridge of about their direction.
    bias, rmse, largest : float
        Of the elevation of the result's ridge less that of the reference's, at the middle of the latter;
        the last without its sign [m].
    """

    n_reference: int
    recall: float
    bias: float
    rmse: float
    largest: float


def score_ridges(result: Wireframe, reference: Wireframe, tolerance: float) -> RidgeScore:
    """
    Compare the elevation of each ridge with that of the nearest ridge of the result.

    Parameters
    ----------
    result, reference : Wireframe
    tolerance : float
        How far beside the reference's ridge, in plan, that of the result may lie [m].
    """
    ridges = reference.segments[reference.is_ridge]
    errors = ridge_errors(result.segments[result.is_ridge], ridges, tolerance)
    found = errors[np.isfinite(errors)]
    return RidgeScore(
        n_reference=len(ridges),
        recall=ratio(len(found), len(ridges)),
        bias=float(np.mean(found)) if len(found) else math.nan,
        rmse=float(np.sqrt(np.mean(found**2))) if len(found) else math.nan,
        largest=float(np.abs(found).max()) if len(found) else math.nan,
    )


def ridge_errors(
    result: NDArray[np.float64], reference: NDArray[np.float64], tolerance: float
) -> NDArray[np.float64]:
    """
    Return how much too high the result's ridge is at the middle of each of the reference's [m], NaN if none.

    Parameters
    ----------
    result, reference : ndarray of shape (n, 2, 3)
        The ends of ridges [m].
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
