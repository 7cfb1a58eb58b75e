"""Intensities brought to one scale: 0 to 255, the same on every sensor and in every flight strip."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Shares of a strip's pulses with one return that are darker than the scale's lower and upper anchor [%].
LOW_PERCENTILE = 1.0
HIGH_PERCENTILE = 95.0
#: Where the upper anchor lies; what is brighter has room above it.
HIGH_ANCHOR = 200.0
#: The brightest normalised intensity; the scale begins at 0.
BRIGHTEST = 255.0
#: A strip with fewer pulses tells nothing of its own scale.
MIN_PULSES = 500


class IntensityScale(NamedTuple):
    """The intensities of a strip that become 0 and `HIGH_ANCHOR`; equal where all its intensities are."""

    low: float
    high: float


def measure_scale(intensity: NDArray[np.floating]) -> IntensityScale:
    """Return the scale of some pulses of one strip; there has to be one at least."""
    return IntensityScale(*np.percentile(intensity, [LOW_PERCENTILE, HIGH_PERCENTILE]).tolist())


def strip_scales(
    intensity: NDArray[np.floating], strip: NDArray[np.integer], is_single: NDArray[np.bool_]
) -> dict[int, IntensityScale]:
    """
    Measure the scale of every flight strip that has a point; of none if there is no single return at all.

    Sensors and flying heights change gain and offset from strip to strip, so that each is anchored at two
    percentiles of its own. Only pulses that came back as one return are looked at: where a pulse was split
    among leaves, every part is dark. A strip with few of them takes the scale of all strips together.
    """
    single = intensity[is_single]
    if not len(single):
        return {}
    common = measure_scale(single)
    of = strip[is_single]
    scales = {}
    for number in np.unique(strip).tolist():
        mine = single[of == number]
        scales[number] = measure_scale(mine) if len(mine) >= MIN_PULSES else common
    return scales


def normalised_intensity(
    intensity: NDArray[np.floating],
    strip: NDArray[np.integer],
    scales: Mapping[int, IntensityScale],
    other: IntensityScale | None = None,
) -> NDArray[np.float32]:
    """
    Bring intensities to the common scale, 0 to 255; 0 throughout a strip of constant intensity.

    `other` is for strips that have no scale; these become 0 without.
    """
    normalised = np.zeros(len(intensity), dtype=np.float32)
    for number in np.unique(strip).tolist():
        scale = scales.get(number, other)
        if scale is not None and scale.high > scale.low:
            mine = strip == number
            gain = HIGH_ANCHOR / (scale.high - scale.low)
            normalised[mine] = np.clip((intensity[mine] - scale.low) * gain, 0.0, BRIGHTEST)
    return normalised
