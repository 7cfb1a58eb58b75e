"""Intensities brought to one scale, whatever sensor or strip, and how bright the ground is, cell by cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.neighbours.cell_grid import mark_cells

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


#: Side of a cell: so many spacings (four pulses a cell), and at least so many metres.
CELL_SPACINGS = 2.0
MIN_CELL = 1.0
#: Largest number of cells, empty ones included; the cells grow beyond.
MAX_CELLS = 2_000_000
#: A cell with fewer known cells around it, itself included, does not show how even the ground is.
MIN_AROUND = 6
#: Steps to which a normalised intensity is rounded before cells are summed up, per unit.
STEPS = 64.0
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


@dataclass(frozen=True, eq=False)
class BrightnessRaster:
    """The ground's brightness on a raster aligned to the map's origin."""

    cell: float  #: side of a cell [m]
    row_of: NDArray[np.int64]  #: the flat index of each ground point's cell, shape (n_points,)
    is_ground: NDArray[np.bool_]  #: cells that hold ground points, shape (n_columns, n_rows)
    #: Cells with leaves above; their ground looks darker than it is, shape (n_columns, n_rows).
    is_covered: NDArray[np.bool_]
    #: Median of the normalised intensities of a cell and the eight around it; NaN where not known, shape
    #: (n_columns, n_rows).
    brightness: NDArray[np.float64]

    @property
    def is_known(self) -> NDArray[np.bool_]:
        """Cells whose brightness is known."""
        return np.isfinite(self.brightness)

    def dark_limit(self) -> float | None:
        """
        Return the brightness that parts dark ground from bright, None where the ground has one mode only.

        Only cells under the open sky in the more even half of the ground are counted: those along edges, half
        dark and half bright, would fill the valley between the modes (Weszka and Rosenfeld, 1979).
        """
        unevenness = _range_around(self.brightness)
        known = np.isfinite(unevenness) & ~self.is_covered
        if not known.any():
            return None
        even = known & (unevenness <= np.median(unevenness[known]))
        return valley_between_modes(self.brightness[even])


def brightness_raster(
    ground: NDArray[np.float64],
    normalised: NDArray[np.floating],
    is_single: NDArray[np.bool_],
    spacing: float,
    cover: NDArray[np.float64] | None = None,
) -> BrightnessRaster:
    """
    Measure the brightness of the ground, one point at least, by pulses' only returns: others are too dark.

    `cover` are leaves above the ground.
    """
    cell = max(CELL_SPACINGS * spacing, MIN_CELL)
    low, high = extent_of(ground)[:, :2]
    while np.prod((high - low) / cell + 2.0) > MAX_CELLS:
        cell *= 2.0
    first, last = (np.floor(end / cell).astype(np.int64) for end in (low, high))
    shape = tuple(last - first + 1)
    row_of, count, total, is_ground = _gathered(
        ground, normalised, is_single, cell, first[0], first[1], shape[0], shape[1]
    )
    mean = np.divide(total, count * STEPS, out=np.full(shape, np.nan), where=count > 0)
    is_covered = np.zeros(shape, dtype=bool)
    if cover is not None:
        mark_cells(cover, cell, first[0], first[1], is_covered)
    return BrightnessRaster(cell, row_of, is_ground, is_covered, _median_around(mean))


@kernel
def _gathered(points, normalised, is_single, cell, low_x, low_y, n_columns, n_rows):  # type: ignore[no-untyped-def]
    """Return each point's flat cell; of cells count and whole sum of single returns, and if any point."""
    row_of = np.empty(len(points), dtype=np.int64)
    count, total = np.zeros(n_columns * n_rows, dtype=np.int64), np.zeros(n_columns * n_rows)
    is_held = np.zeros(n_columns * n_rows, dtype=np.bool_)
    for i in range(len(points)):
        x, y = np.floor(points[i, 0] / cell) - low_x, np.floor(points[i, 1] / cell) - low_y
        at = int(x) * n_rows + int(y)
        row_of[i], is_held[at] = at, True
        if is_single[i]:
            count[at] += 1
            total[at] += np.rint(np.float64(normalised[i]) * STEPS)
    shape = n_columns, n_rows
    return row_of, count.reshape(shape), total.reshape(shape), is_held.reshape(shape)


def _median_around(values: NDArray[np.float64]) -> NDArray[np.float64]:
    columns, rows = values.shape
    framed = np.pad(values, 1, constant_values=np.nan)
    around = np.stack([framed[i : i + columns, j : j + rows] for i in range(3) for j in range(3)])
    around.sort(axis=0)  # NaN come last
    n_known = np.isfinite(around).sum(axis=0)
    lower = np.take_along_axis(around, np.maximum(n_known - 1, 0)[np.newaxis] // 2, axis=0)[0]
    upper = np.take_along_axis(around, n_known[np.newaxis] // 2 * (n_known > 0), axis=0)[0]
    return np.where(np.isfinite(values), (lower + upper) / 2, np.nan)


def _range_around(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far the values within each cell's eight neighbours differ; NaN where too few are known."""
    known = np.isfinite(values)
    highest = ndimage.maximum_filter(np.where(known, values, -np.inf), 3, mode="constant", cval=-np.inf)
    lowest = ndimage.minimum_filter(np.where(known, values, np.inf), 3, mode="constant", cval=np.inf)
    n_known = ndimage.convolve(known.astype(np.int64), np.ones((3, 3), dtype=np.int64), mode="constant")
    with np.errstate(invalid="ignore"):
        return np.where(known & (n_known >= MIN_AROUND), highest - lowest, np.nan)


def valley_between_modes(values: NDArray[np.floating]) -> float | None:
    """
    Find the brightness that parts a dark mode from a bright one; None for one mode, or too little to tell.

    Thresholds that part two groups best exist whether there are two or not (Otsu, 1979). Here the floor
    between two peaks of the smoothed histogram has to be clearly lower than both; the middle of the deepest
    such floor parts them.
    """
    if len(values) < MIN_VALUES:
        return None
    edges = np.arange(0.0, BRIGHTEST + BIN, BIN)
    counts = np.histogram(values, edges)[0].astype(float)
    smooth = ndimage.gaussian_filter1d(counts, SMOOTHING / BIN, mode="constant")
    # The lower one of the highest peaks on both sides of each bin.
    peak = np.minimum(np.maximum.accumulate(smooth), np.maximum.accumulate(smooth[::-1])[::-1])
    depth, share = peak - smooth, np.cumsum(counts) / len(values)
    # Smoothing averages some bins, so that its counts scatter less than Poisson's.
    scatter = np.sqrt(peak / (2.0 * np.sqrt(np.pi) * SMOOTHING / BIN))
    is_valley = (smooth <= MAX_VALLEY * peak) & (depth >= VALLEY_CERTAINTY * scatter)
    is_valley &= (share >= MIN_SHARE) & (share <= 1.0 - MIN_SHARE)
    if not is_valley.any():
        return None
    deepest = int(np.argmax(np.where(is_valley, depth, -1.0)))
    floor = is_valley & (peak == peak[deepest]) & (depth >= 0.95 * depth[deepest])
    return float(edges[:-1][floor].mean() + BIN / 2.0)
