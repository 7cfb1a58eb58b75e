"""Shares, means and percentiles that are NaN where there is nothing to take them of."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
