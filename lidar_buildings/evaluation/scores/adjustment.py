"""How well outlines fit the points that they were made from: Table 1 of Sampath & Shan (2007)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lidar_buildings.evaluation.scores.statistics import mean, ratio, root_mean_square


@dataclass(frozen=True)
class AdjustmentScore:
    """
    Means over buildings with straight or curved walls; NaN if there are none.

    `doc/scores.md` says what the figures are.
    """

    n_buildings: int
    n_as_traced: int
    spacing: float
    max_offset: float
    sigma: float
    max_offset_share: float
    sigma_share: float


def score_adjustment(spacing: ArrayLike, sigma: ArrayLike, max_offset: ArrayLike) -> AdjustmentScore:
    """
    Average what the least squares adjustment says of its buildings, as the paper does.

    Parameters
    ----------
    spacing, sigma, max_offset : array_like of shape (n_buildings,)
        Per building [m]; NaN where unknown, σ = 0 where the outline is the traced one.

    Raises
    ------
    ValueError
        If the lengths differ.
    """
    columns = [np.asarray(column, dtype=np.float64) for column in (spacing, sigma, max_offset)]
    if len({column.shape for column in columns}) > 1:
        shapes = [column.shape for column in columns]
        raise ValueError(f"spacing, sigma and max_offset have shapes {shapes}: must be one per building")
    known = np.isfinite(columns).all(axis=0)
    fitted = known & (columns[1] > 0)
    count = int(fitted.sum())
    spacings, sigmas, offsets = (column[fitted] for column in columns)
    means = mean(spacings), mean(offsets), root_mean_square(sigmas)
    return AdjustmentScore(
        n_buildings=count,
        n_as_traced=int((known & ~fitted).sum()),
        spacing=means[0],
        max_offset=means[1],
        sigma=means[2],
        max_offset_share=ratio(means[1], means[0]),
        sigma_share=ratio(means[2], means[0]),
    )
