"""What stands within or beside an outline, or at a place, and was not taken for roof, and by which limits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from lidar_buildings.core.model.classes import Facade, PointClass
from lidar_buildings.report.explain.finding import Finding, Limits
from lidar_buildings.report.explain.outline_findings import shape_of
from lidar_buildings.report.explain.site import Site

_SELECTION = ("roof_selection.max_roughness", "roof_selection.max_part_area")
#: How far beside an outline rejected points are looked for [m].
_REACH = 1.5
#: Groups of rejected points that cover less are not told of [m²].
_LEAST = 3.0
#: Fewer rejected points are not told of, as a share of the building's.
_FEW = 0.03
#: Neighbours that tell whether a surface is smooth.
_NEIGHBOURS = 12


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
    least = max(_NEIGHBOURS, _FEW * np.count_nonzero(site.building_id == number))
    for chosen, place in ((inside & is_high, "within the outline"), (near & ~inside & is_high, "round it")):
        if chosen.sum() >= least:
            parameters = _SELECTION if place == "within the outline" else (*_SELECTION, "segmentation.window")
            yield Finding(
                f"High points {place} that are not of the building: {site.select(chosen).per_class()}.",
                parameters,
            )


def rejected_at(site: Site, spacing: float, limits: Limits) -> Iterator[Finding]:
    """Yield why there is no building at a place, by the limits that its points fail."""
    yield Finding(f"{len(site.points):,} points around: {site.per_class()}.")
    if not len(site.points):
        return
    if np.isnan(site.height).all():
        yield Finding(
            "They are in no finished tile: run.json says which failed, --retry-failed does it again."
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
            f"{int(is_wall.sum()):,} points of walls over which no roof was seen: they get an outline where "
            "they enclose something, walls in two directions at right angles, and no ground behind them."
        )
    is_free = is_building & (site.facade == Facade.NONE) & (site.building_id == 0)
    if is_free.any():
        area = shape_of(site.points[is_free], spacing).area
        yield Finding(
            f"{int(is_free.sum()):,} roof points on {area:.1f} m² belong to no building.",
            ("segmentation.min_area", "segmentation.min_points", "segmentation.window"),
        )
    yield from _rejected_surfaces(site.select(is_high & ~is_building), spacing, limits)


def _rejected_surfaces(high: Site, spacing: float, limits: Limits) -> Iterator[Finding]:
    """Say what hinders groups of high points from being roofs: their area, width or roughness."""
    if not len(high.points):
        return
    if len(high.points) < _NEIGHBOURS:
        yield Finding(f"{len(high.points)} points are high enough for a roof, too few for one.")
        return
    parts = shapely.get_parts(shape_of(high.points, spacing))
    least = limits.value("roof_selection.min_building_area")
    for part in sorted(parts, key=lambda one: -one.area)[:3]:
        if part.area < _LEAST:
            continue
        own = high.select(shapely.dwithin(part, shapely.points(high.points[:, :2]), spacing))
        rough, width = _roughness(own), _width(part)
        words = [f"{len(own.points):,} points on {part.area:.1f} m², {width:.1f} m wide, {rough:.2f} m rough"]
        words.append(f"{np.median(own.height):.1f} m above the ground: {own.per_class()}")
        failed = []
        if part.area < least:
            failed.append(("smaller than min_building_area", "roof_selection.min_building_area"))
        if width < limits.value("roof_selection.min_building_width"):
            failed.append(("narrower than min_building_width", "roof_selection.min_building_width"))
        if rough > limits.value("roof_selection.max_roughness"):
            failed.append(("rougher than max_roughness", "roof_selection.max_roughness"))
        why = ", ".join(text for text, _ in failed) or "seen as foliage or as hidden below it"
        yield Finding(f"High but no roof: {', '.join(words)}: {why}.", tuple(name for _, name in failed))


def _roughness(site: Site) -> float:
    """Return the median scatter of points about the planes through their neighbours [m]."""
    from scipy.spatial import cKDTree  # a few thousand points at most

    n = min(_NEIGHBOURS, len(site.points))
    _, rows = cKDTree(site.points).query(site.points, n)
    groups = site.points[rows] - site.points[rows].mean(axis=1, keepdims=True)
    least = np.linalg.svd(groups, compute_uv=False)[:, -1]
    return float(np.median(least) / np.sqrt(n))


def _width(shape: shapely.Geometry) -> float:
    """Return the shorter side of the smallest rectangle round a shape [m]."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shape))
    sides = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    return float(sides.min()) if len(sides) else 0.0
