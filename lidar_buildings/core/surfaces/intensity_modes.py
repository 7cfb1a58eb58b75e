"""The two modes of a histogram of brightness, where there are two."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.surfaces.intensity import BRIGHTEST

#: Width of a bin of the histogram, and of the bell that smooths it [of 255].
BIN = 2.0
SMOOTHING = 4.0
#: A histogram of fewer values shows no modes.
MIN_VALUES = 1000
#: The least share of the values on either side of the valley.
MIN_SHARE = 0.01
#: Depth of the valley: its floor stays below this part of the lower of the two peaks.
MAX_VALLEY = 0.75
#: By how many standard deviations of a count the valley's floor has to stay below.
VALLEY_CERTAINTY = 3.0


def valley_between_modes(values: NDArray[np.floating]) -> float | None:
    """
    Find the brightness that parts a dark mode from a bright one.

    Thresholds that part two groups best exist whether there are two or not: Otsu's (1979), and that of least
    error (Kittler and Illingworth, 1986) for a small group beside a large one. Here they only say on which
    side to look for either peak of the smoothed histogram; if the floor between the peaks is clearly lower
    than both, there are two modes, and the middle of that floor parts them.

    Parameters
    ----------
    values : ndarray of shape (n_values,)
        Normalised intensities, 0 to 255.

    Returns
    -------
    float or None
        None where there is one mode, or too little to tell.
    """
    if len(values) < MIN_VALUES:
        return None
    edges = np.arange(0.0, BRIGHTEST + BIN, BIN)
    counts = np.histogram(values, edges)[0].astype(float)
    for parting in (_otsu(counts), _least_error(counts)):
        limit = _valley_around(parting, counts, edges)
        if limit is not None and MIN_SHARE <= np.mean(values <= limit) <= 1 - MIN_SHARE:
            return limit
    return None


def _valley_around(parting: int, counts: NDArray[np.float64], edges: NDArray[np.float64]) -> float | None:
    """Return the middle of the valley between the highest peaks on both sides of a bin, if there is one."""
    smooth = ndimage.gaussian_filter1d(counts, SMOOTHING / BIN, mode="constant")
    dark, bright = int(np.argmax(smooth[: parting + 1])), parting + 1 + int(np.argmax(smooth[parting + 1 :]))
    between = smooth[dark : bright + 1]
    floor, peak = between.min(), min(smooth[dark], smooth[bright])
    # Smoothing averages some bins, so that its counts scatter less than Poisson's.
    scatter = VALLEY_CERTAINTY * np.sqrt(peak / (2 * np.sqrt(np.pi) * SMOOTHING / BIN))
    if floor > MAX_VALLEY * peak or floor > peak - scatter:
        return None
    lowest = dark + np.flatnonzero(between <= floor + 0.05 * (peak - floor))
    return float(edges[lowest].mean() + BIN / 2)


def _otsu(counts: NDArray[np.float64]) -> int:
    """Return the last bin of the darker class, the variance between classes being largest (Otsu, 1979)."""
    place = np.arange(len(counts))
    below, total = np.cumsum(counts), counts.sum()
    moment = np.cumsum(counts * place)
    both = below * (total - below)
    apart = (moment[-1] * below - total * moment) ** 2
    between = np.divide(apart, both, out=np.zeros(len(both)), where=both > 0)
    return min(int(np.argmax(between)), len(counts) - 2)


def _least_error(counts: NDArray[np.float64]) -> int:
    """Return the last bin of the darker of two normal classes (Kittler and Illingworth, 1986, eq. 15)."""
    place = np.arange(len(counts))
    sums = np.cumsum(np.stack([counts, counts * place, counts * place**2]), axis=1)
    criterion = np.zeros(len(counts))
    for n, first, second in (sums, sums[:, -1:] - sums):
        n_safe = np.maximum(n, 1.0)
        # A class of one bin has the variance of an even spread over it.
        variance = np.maximum(second / n_safe - (first / n_safe) ** 2, 1 / 12)
        criterion += n / sums[0, -1] * (np.log(variance) - 2 * np.log(n_safe / sums[0, -1]))
    return min(int(np.argmin(np.where(criterion == 0, np.inf, criterion))), len(counts) - 2)
