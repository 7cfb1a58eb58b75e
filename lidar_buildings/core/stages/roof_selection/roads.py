"""Roads: ground that is darker than the rest over an area, not here and there."""

from __future__ import annotations

import logging
import math
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from lidar_buildings.core.model.point_array import checked_column
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.surfaces.intensity import BrightnessRaster, brightness_raster, strip_scales
from lidar_buildings.core.surfaces.intensity import normalised_intensity as normalised_by_strip

_log = logging.getLogger(__name__)

#: Side of the square of cells whose majority decides on ground of unknown brightness, as under trees.
FILL_CELLS = 5
#: Narrowest road, one lane; narrower are paths and the dark edges of walls and hedges [m].
MIN_WIDTH = 3.0
#: Cells that touch at a side or a corner are connected.
_AROUND = np.ones((3, 3), dtype=bool)


def find_roads(
    ground: NDArray[np.float64],
    normalised: NDArray[np.floating],
    is_single: NDArray[np.bool_],
    spacing: float,
    config: RoofSelectionConfig,
    *,
    cover: NDArray[np.float64] | None = None,
    dark_limit: float | None = None,
) -> NDArray[np.bool_]:
    """
    Tell which ground points are road.

    Ground whose brightness lies between two thresholds is road (Mancera-Taboada and others, 2012), the
    thresholds being given, or the upper one found where the ground's brightness has two modes. Brightness is
    the median over cells, so that single dark points do not count; what is narrower than `MIN_WIDTH` or
    has less than `min_road_area` under the open sky is left out; ground of unknown brightness follows what is
    around it.

    Ground points have shape (n, 3) [m]; `normalised` are their intensities, 0 to 255, `is_single` says which
    are the only return of their pulse, `cover` are leaves above the ground, shape (m, 3) [m]. `dark_limit`
    is the brightness of the darkest other ground, for the automatic search, if it is known.
    """
    nothing = np.zeros(len(ground), dtype=bool)
    if config.road_method == "none" or not is_single.any():
        return nothing
    raster = brightness_raster(ground, normalised, is_single, spacing, cover)
    limits: tuple[float, float | None] = config.min_road_intensity, config.max_road_intensity
    if config.road_method != "thresholds":
        limits = 0.0, raster.dark_limit() if dark_limit is None else dark_limit
    if limits[1] is None:
        return nothing
    with np.errstate(invalid="ignore"):
        dark = (raster.brightness >= limits[0]) & (raster.brightness <= limits[1])
    wide = _wide(dark, raster.is_known & ~dark, MIN_WIDTH / raster.cell)
    road = _filled(wide, raster)
    part, _ = ndimage.label(road, structure=_AROUND)
    size = np.bincount(part[~raster.is_covered], minlength=part.max() + 1)
    is_large = size >= config.min_road_area / raster.cell**2
    return (is_large[part] & road).ravel()[raster.row_of]


def road_greys(
    ground: NDArray[np.float64],
    normalised: NDArray[np.floating],
    is_single: NDArray[np.bool_],
    spacing: float,
    config: RoofSelectionConfig,
    *,
    cover: NDArray[np.float64] | None = None,
    dark_limit: float | None = None,
) -> NDArray[np.bool_]:
    """
    Tell which ground points have the grey of roads, each by itself (Mancera-Taboada and others, 2012).

    Arguments are those of `find_roads`. It is logged, once a process, if the brightness of the ground has
    one mode only: then the thresholds cut through one kind of ground.
    """
    if dark_limit is None and is_single.any():
        raster = brightness_raster(ground, normalised, is_single, spacing, cover)
        if raster.dark_limit() is None:
            _say_one_mode()
    return np.asarray((normalised >= config.min_road_intensity) & (normalised <= config.max_road_intensity))


@cache
def _say_one_mode() -> None:
    _log.warning(
        "roof_selection.road_method = grey_values: the intensities of the ground have one mode, which does "
        "not tell roads from the rest: look at class 11, or set road_method to none"
    )


def _wide(dark: NDArray[np.bool_], bright: NDArray[np.bool_], width: float) -> NDArray[np.bool_]:
    """Remove what is narrower than a width [cells] between bright ground on both sides."""
    # An opening for which cells that are no ground, or of unknown brightness, do not count as bright: cars
    # and walls beside a road do not make it narrower.
    radius = width / 2
    reach = math.ceil(radius) - 1
    if reach < 1:
        return dark
    across = np.arange(-reach, reach + 1)
    disc = np.hypot(*np.meshgrid(across, across)) < radius
    core = dark & ~ndimage.binary_dilation(bright, disc)
    return dark & ndimage.binary_dilation(core, disc)


def _filled(road: NDArray[np.bool_], raster: BrightnessRaster) -> NDArray[np.bool_]:
    """Add ground of unknown brightness that has more road than other ground around it."""
    known = raster.is_known
    share = ndimage.uniform_filter(road.astype(float), FILL_CELLS, mode="constant")
    among = ndimage.uniform_filter(known.astype(float), FILL_CELLS, mode="constant")
    return road | (raster.is_ground & ~known & (share > among / 2) & (share > 0.5 / FILL_CELLS**2))


def point_brightness(
    n_points: int,
    intensity: ArrayLike | None,
    normalised: ArrayLike | None,
    strip: ArrayLike | None,
    is_only: NDArray[np.bool_],
) -> NDArray[np.float32] | None:
    """Return normalised intensities as given, or from the intensities; None without either."""
    if normalised is not None:
        return checked_column("normalised_intensity", normalised, n_points, np.float32)
    if intensity is None:
        return None
    values = checked_column("intensity", intensity, n_points, np.float32)
    given = np.zeros(n_points, dtype=np.int64) if strip is None else strip
    strips = checked_column("point_source_id", given, n_points, np.int64)
    return normalised_by_strip(values, strips, strip_scales(values, strips, is_only))
