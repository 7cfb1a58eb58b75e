"""Counts of yes and no, shares, means and percentiles; NaN where there is nothing to take them of."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Confusion:
    """What the result says against what the reference says; a figure without a base (0/0) is NaN."""

    hits: int  #: yes in both
    false_alarms: int  #: yes in the result only
    misses: int  #: yes in the reference only
    rejections: int  #: no in both

    @property
    def total(self) -> int:
        """Number of items asked about."""
        return self.hits + self.false_alarms + self.misses + self.rejections

    @property
    def recall(self) -> float:
        """Share of the reference that was found, also called completeness."""
        return ratio(self.hits, self.hits + self.misses)

    @property
    def precision(self) -> float:
        """Share of the result that is right, also called correctness."""
        return ratio(self.hits, self.hits + self.false_alarms)

    @property
    def iou(self) -> float:
        """Intersection over union, also called quality."""
        return ratio(self.hits, self.hits + self.false_alarms + self.misses)

    @property
    def f1(self) -> float:
        """Harmonic mean of recall and precision."""
        return ratio(2 * self.hits, 2 * self.hits + self.false_alarms + self.misses)

    @property
    def kappa(self) -> float:
        """
        Agreement beyond what chance would give (Cohen 1960): 1 is perfect, 0 is chance.

        NaN where both say the same single answer throughout: there is nothing to agree on beyond chance.
        """
        yes = (self.hits + self.false_alarms) * (self.hits + self.misses)
        no = (self.misses + self.rejections) * (self.false_alarms + self.rejections)
        expected = yes + no
        # In whole numbers: both sides of (p_o − p_e) / (1 − p_e) times total².
        return ratio((self.hits + self.rejections) * self.total - expected, self.total**2 - expected)


def confusion_of(result: ArrayLike, reference: ArrayLike) -> Confusion:
    """
    Count the agreement of two masks over the same items; ValueError if their shapes differ or are not 1D.
    """
    result_mask, reference_mask = np.asarray(result, bool), np.asarray(reference, bool)
    if result_mask.ndim != 1 or result_mask.shape != reference_mask.shape:
        given = reference_mask.shape
        raise ValueError(f"reference has shape {given}: must be one-dimensional, as long as result")
    hits = int(np.count_nonzero(result_mask & reference_mask))
    yes, wanted = int(np.count_nonzero(result_mask)), int(np.count_nonzero(reference_mask))
    return Confusion(hits, yes - hits, wanted - hits, len(result_mask) - yes - wanted + hits)


def ratio(part: float, whole: float) -> float:
    """Return `part` / `whole`, NaN where `whole` is 0."""
    return part / whole if whole else math.nan


def mean(values: NDArray[Any]) -> float:
    """Return the mean, NaN of nothing."""
    return float(np.mean(values)) if len(values) else math.nan


def percentile(values: NDArray[np.float64], share: float) -> float:
    """Return a percentile, NaN of nothing."""
    return float(np.percentile(values, share)) if len(values) else math.nan


def root_mean_square(values: NDArray[np.float64]) -> float:
    """Return the root of the mean square of the finite values, NaN of none."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if len(finite) else math.nan
