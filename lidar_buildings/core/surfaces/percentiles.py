"""Percentiles of few numbers."""

from __future__ import annotations

from lidar_buildings.core.model.array_types import FloatArray


def percentile_of(rising: FloatArray, share: float) -> float:
    """Return the percentile of rising numbers at a share, as numpy's, which takes 0.1 ms."""
    at = (len(rising) - 1) * share
    low, high = float(rising[int(at)]), float(rising[min(int(at) + 1, len(rising) - 1)])
    part = at - int(at)
    return low + (high - low) * part if part < 0.5 else high - (high - low) * (1.0 - part)
