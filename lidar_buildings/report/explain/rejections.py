"""What stands within or beside an outline, or at a place, and was not taken for roof, and by which limits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import Facade, PointClass, Rejection
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.selection import select_roofs
from lidar_buildings.report.explain.building_findings import shape_of
from lidar_buildings.report.explain.finding import Finding, Limits, Site

_SELECTION = ("roof_selection.max_roughness", "roof_selection.max_part_area")
#: How far beside an outline rejected points are looked for [m].
_REACH = 1.5
#: Groups of rejected points that cover less are not told of [m²].
_LEAST = 3.0
#: Fewer rejected points are not told of, as a share of the building's.
_FEW = 0.03
#: Fewer high points are too few for a roof.
_FEWEST = 12
#: What is said of points for each reason of roof selection, and the parameter that decides.
_WORDS = {
    Rejection.LOW: ("lower than min_height", "min_height"),
    Rejection.FOLIAGE: ("seen as foliage or as hidden below it", None),
    Rejection.ROUGH: ("rougher than max_roughness", "max_roughness"),
    Rejection.STEEP: ("steeper than a roof", None),
    Rejection.DECK: ("seen as a bridge", None),
    Rejection.NARROW_PART: ("narrower than min_roof_width", "min_roof_width"),
    Rejection.NARROW_BUILDING: ("narrower than min_building_width", "min_building_width"),
    Rejection.SMALL: ("smaller than min_building_area", "min_building_area"),
    Rejection.ENDLESS: ("surrounded by similar patches, like parts of a tree crown", None),
}
#: What is as narrow may be too small as well.
_NARROW = (Rejection.NARROW_PART, Rejection.NARROW_BUILDING)


def rejected_beside(site: Site, number: int, outline: shapely.Polygon, limits: Limits) -> Iterator[Finding]:
    """Yield what is high within an outline and round it, and not of its building."""
    where = shapely.points(site.points[:, :2])
    near = shapely.dwithin(outline, where, _REACH)
    inside = shapely.contains(outline, where)
    is_high = (
        (site.height >= limits.value("roof_selection.min_height"))
        & (site.building_id != number)
        & (site.facade == 0)
    )
    least = max(_FEWEST, _FEW * np.count_nonzero(site.building_id == number))
    for chosen, place in ((inside & is_high, "within the outline"), (near & ~inside & is_high, "round it")):
        if chosen.sum() >= least:
            parameters = _SELECTION if place == "within the outline" else (*_SELECTION, "segmentation.window")
            yield Finding(
                f"High points {place} outside the building: {site.select(chosen).per_class()}.", parameters
            )


def rejected_at(
    around: Site, is_here: NDArray[np.bool_], spacing: float, limits: Limits
) -> Iterator[Finding]:
    """
    Yield why there is no building at a place, by the limits that its points fail.

    `around` are all points by which roof selection decides on those here.
    """
    site = around.select(is_here)
    yield Finding(f"{len(site.points):,} points around: {site.per_class()}.")
    if not len(site.points):
        return
    if np.isnan(site.height).all():
        yield Finding(
            "They are in no finished tile: run.json lists failed tiles; --retry-failed reprocesses them."
        )
        return
    is_high = site.height >= limits.value("roof_selection.min_height")
    if not is_high.any():
        yield Finding(
            f"The highest point is {np.nanmax(site.height):.2f} m above the ground, below min_height.",
            ("roof_selection.min_height", "ground_filter.seed_cell"),
        )
        return
    is_building = is_high & (site.classification == PointClass.BUILDING)
    is_wall = is_building & (site.facade == Facade.BARE)
    if is_wall.any() and not (site.building_id > 0).any():
        yield Finding(
            f"{int(is_wall.sum()):,} points of walls without a visible roof above: they get an outline where "
            "they enclose something, walls in two directions at right angles, and no ground behind them."
        )
    is_free = is_building & (site.facade == Facade.NONE) & (site.building_id == 0)
    if is_free.any():
        area = shape_of(site.points[is_free], spacing).area
        yield Finding(
            f"{int(is_free.sum()):,} roof points on {area:.1f} m² belong to no building.",
            ("segmentation.min_area", "segmentation.min_points", "segmentation.window"),
        )
    is_rejected = is_here.copy()
    is_rejected[is_here] = is_high & ~is_building
    yield from _rejected_surfaces(around, is_rejected, spacing, limits)


def _rejected_surfaces(
    around: Site, is_rejected: NDArray[np.bool_], spacing: float, limits: Limits
) -> Iterator[Finding]:
    is_known = np.isfinite(around.height)  # those of tiles that failed are not
    around, is_rejected = around.select(is_known), is_rejected[is_known]
    high = around.select(is_rejected)
    if not len(high.points):
        return
    if len(high.points) < _FEWEST:
        yield Finding(f"{len(high.points)} points are high enough for a roof, too few for one.")
        return
    parts = [part for part in shapely.get_parts(shape_of(high.points, spacing)) if part.area >= _LEAST]
    if not parts:
        return
    selection = select_roofs(
        around.points,
        limits.config(RoofSelectionConfig),
        height_above_ground=around.height,
        classification=around.classification.astype(np.uint8),
        return_number=around.return_number,
        number_of_returns=around.number_of_returns,
    )
    reasons = selection.rejection[is_rejected]
    for part in sorted(parts, key=lambda one: -one.area)[:3]:
        is_own = shapely.dwithin(part, shapely.points(high.points[:, :2]), spacing)
        own = high.select(is_own)
        named = [Rejection(int(np.bincount(reasons[is_own]).argmax()))]
        if named[0] in _NARROW and part.area < limits.value("roof_selection.min_building_area"):
            named.append(Rejection.SMALL)
        words = [
            _WORDS.get(one, ("classified as roof now: the run used other points", None)) for one in named
        ]
        yield Finding(
            f"High but no roof: {len(own.points):,} points on {part.area:.1f} m², "
            f"{np.median(own.height):.1f} m above the ground: {own.per_class()}: "
            f"{', '.join(text for text, _ in words)}.",
            tuple(f"roof_selection.{name}" for _, name in words if name),
        )
