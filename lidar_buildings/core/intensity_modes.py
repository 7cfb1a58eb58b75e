"""
The two modes of a histogram of brightness, where there are two.

"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.intensity import BRIGHTEST

#: Width of a bin of the histogram, and of the bell that smooths it [of 255].
BIN = 2.0
SMOOTHING = 4.0
#: A histogram of fewer values shows no modes.
MIN_VALUES = 1000
#: The least share of the values on either side of the valley.
MIN_SHARE = 0.05
#: Depth of the valley: its floor stays below this part of the lower of the two peaks.
MAX_VALLEY = 0.75
#: By how many standard deviations of a count the valley's floor has to stay below.
VALLEY_CERTAINTY = 2.0


def valley_between_modes(values: NDArray[np.floating]) -> float | None:
    """
    Find the brightness that parts a dark mode from a bright one.

    Otsu's threshold (1979) tells where two groups part best, whether there are two or not. Here it only says
    on which side of it to look for either peak of the smoothed histogram; if the floor between the peaks is
    clearly lower than both, there are two modes, and the middle of that floor parts them.

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
    smooth = ndimage.gaussian_filter1d(counts, SMOOTHING / BIN, mode="constant")
    parting = _otsu(counts)
    dark, bright = int(np.argmax(smooth[: parting + 1])), parting + 1 + int(np.argmax(smooth[parting + 1 :]))
    between = smooth[dark : bright + 1]
    floor, peak = between.min(), min(smooth[dark], smooth[bright])
    # Smoothing averages some bins, so that its counts scatter less than Poisson's.
    scatter = VALLEY_CERTAINTY * np.sqrt(peak / (2 * np.sqrt(np.pi) * SMOOTHING / BIN))
    if floor > MAX_VALLEY * peak or floor > peak - scatter:
        return None
    lowest = dark + np.flatnonzero(between <= floor + 0.05 * (peak - floor))
    limit = float(edges[lowest].mean() + BIN / 2)
    share = float(np.mean(values <= limit))
    return limit if MIN_SHARE <= share <= 1 - MIN_SHARE else None


def _otsu(counts: NDArray[np.float64]) -> int:
    """
    Return the last bin of the darker class, the classes' variance between them being largest (Otsu 1979).

    """
    place = np.arange(len(counts))
    below, total = np.cumsum(counts), counts.sum()
    moment = np.cumsum(counts * place)
    both = below * (total - below)
    between = np.divide(
        (moment[-1] * below - total * moment) ** 2, both, out=np.zeros(len(both)), where=both > 0
    )
    return min(int(np.argmax(between)), len(counts) - 2)
