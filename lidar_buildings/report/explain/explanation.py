"""The text that explains a building, or why there is none at a place."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import FacadeClass, PointClass, Rejection
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.selection import select_roofs
from lidar_buildings.io.models.cityjson import parse_feature
from lidar_buildings.io.results.run_summary import counted
from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.report.explain.building_findings import (
    Finding,
    Limits,
    Site,
    line_findings,
    outline_findings,
    read_site,
    roof_findings,
    shape_of,
)
from lidar_buildings.report.result_folder import GPKG, ReportedBuilding, Result
from lidar_buildings.report.summary_words import early_end

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
    """Yield which limits the points at a place fail, `around` which stand those that decide on them."""
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
    is_wall = is_building & (site.facade == FacadeClass.BARE)
    if is_wall.any() and not (site.building_id > 0).any():
        yield Finding(
            f"{int(is_wall.sum()):,} points of walls without a visible roof above: they get an outline where "
            "they enclose something, walls in two directions at right angles, and no ground behind them."
        )
    is_free = is_building & (site.facade == FacadeClass.NONE) & (site.building_id == 0)
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
        yield Finding(f"High enough for a roof, but too few: {counted(len(high.points), 'point')}.")
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


#: A place as X,Y in the source's coordinates.
_PLACE = re.compile(r"\s*([-+]?\d+(?:\.\d*)?)\s*[, ]\s*([-+]?\d+(?:\.\d*)?)\s*")
#: A place so near to a building means that building [m]: its name may say a place beside its outline.
_BESIDE = 1.0
#: How far round a place points are looked at [m].
_RADIUS = 8.0
#: How far beyond these lie the points by which roof selection decides on them: across a building [m].
_CONTEXT = 30.0
#: Of a survey of which nothing tells the spacing [m].
_SPACING = 0.5
_QUALITY = ("rmse", "coverage", "outline_sigma")


def find_building(result: Result, name: str) -> ReportedBuilding | tuple[float, float]:
    """
    Return the building that a name means, or a place in the map frame [m] where there is none.

    A name is a building's readable id or the end of it, its number, the name of its footprint, or X,Y within
    a metre of it.
    InputError if no building or several are called so.
    """
    found = [
        one
        for one in result.buildings
        if name in (one.name, str(one.building_id), one.attributes.get("footprint_id") or one.name)
    ] or [one for one in result.buildings if one.name.endswith(f"-{name}")]
    if len(found) == 1:
        return found[0]
    place = _PLACE.fullmatch(name)
    if place is None or found:
        known = ", ".join(one.name for one in (found or result.buildings)[:3]) or "none"
        raise InputError(
            f"{result.folder}: {len(found) or 'no'} building is called {name!r} (there are {known}, …): "
            "give a readable_id or a building_id of buildings.gpkg, or X,Y"
        )
    x, y, _ = result.frame.to_map(np.array([[float(place[1]), float(place[2]), 0.0]]))[0].tolist()
    known = [one for one in result.buildings if one.shape is not None and not one.shape.is_empty]
    away = shapely.distance(np.array([one.shape for one in known]), shapely.Point(x, y))
    nearest = int(np.argmin(away)) if len(known) else -1
    return known[nearest] if len(known) and away[nearest] <= _BESIDE else (x, y)


def explain_building(result: Result, building: ReportedBuilding) -> str:
    """Say why a building has its outline and its roof; InputError if a cloud cannot be read."""
    known, frame = building.attributes, result.frame
    spacing = (known.get("point_spacing") or 0.0) * result.unit or _SPACING
    limits = Limits(result.run, spacing)
    sections: dict[str, list[Finding]] = {}
    sections["Outline"] = list(outline_findings(building, spacing, limits))
    if building.shape is not None and not building.shape.is_empty and result.clouds():
        site = read_site(result.clouds(), frame, Rectangle(*building.shape.bounds).grown(3.0))
        number = building.building_id
        roof = site.select((site.building_id == number) & (site.facade == FacadeClass.NONE) & (number > 0))
        is_top = (site.building_id == number) & (site.facade == FacadeClass.BARE)
        if is_top.any():
            sections["Roof"] = [
                Finding(
                    f"Closed behind its walls: {is_top.sum():,} points of the tops of bare walls and "
                    f"{len(roof.points):,} of its roof, which is only partly visible: one height, no planes."
                )
            ]
        elif len(roof.points) and not _ended_before(result, "plane_fitting"):
            line = next(result.lines({building.name}), None)
            solid = None if line is None else parse_feature(line).solid
            sections["Roof"] = list(roof_findings(roof, solid, spacing, frame, limits))
            if result.has(GPKG):
                sections["Roof"] += line_findings(result.folder / GPKG, building.name, result.unit)
        sections["Not of it"] = list(rejected_beside(site, building.building_id, building.shape, limits)) or [
            Finding("Nothing high was rejected within or around the outline.")
        ]
    head = [*_head(building, spacing), *filter(None, [early_end(result.run)])]
    return _text(head, sections, limits)


def explain_place(result: Result, place: tuple[float, float]) -> str:
    """Say why there is no building at a place of the map frame [m]."""
    x, y = place
    around = read_site(result.clouds(), result.frame, Rectangle(x, y, x, y).grown(_RADIUS + _CONTEXT))
    is_here = Rectangle(x, y, x, y).grown(_RADIUS).holds(*around.points[:, :2].T)
    spacing = measure_spacing(around.points) if is_here.any() else _SPACING
    limits = Limits(result.run, spacing)
    findings = list(rejected_at(around, is_here, spacing, limits))
    if _ended_before(result, "boundary_tracing"):
        del findings[1:]  # nothing was rejected
    source = ", ".join(f"{one:.1f}" for one in result.frame.to_source(np.array([[x, y, 0.0]]))[0, :2])
    head = [f"No building at {source}; within {_RADIUS:g} m:"]
    head += filter(None, [early_end(result.run)])
    near = [one for one in result.buildings if one.shape is not None]
    if near:
        distances = shapely.distance(np.array([one.shape for one in near]), shapely.Point(x, y))
        head.append(
            f"The nearest building, {near[int(distances.argmin())].name}, is {distances.min():.1f} m away."
        )
    return _text(head, {"Points": findings}, limits)


def _ended_before(result: Result, stage: str) -> bool:
    return result.run.get("until") in STAGES[: STAGES.index(stage)]


def _head(building: ReportedBuilding, spacing: float) -> list[str]:
    known = building.attributes
    lines = [f"{building.name} (building_id {building.building_id}): {building.status}"]
    if building.quality:
        lines.append(
            f"quality {building.quality}{': ' * bool(building.quality_reasons)}{building.quality_reasons}"
        )
    if known.get("reason"):
        lines.append(f"reason: {known['reason']}")
    words = [
        f"roof {known['roof_type']}" if known.get("roof_type") else "",
        f"LoD{known['lod']}" if known.get("lod") else "no solid",
        f"validity {known['validity']}" if known.get("validity") not in (None, "", "[]", []) else "",
        f"{known['n_points']:,.0f} points {spacing:.2f} m apart" if known.get("n_points") else "",
        *(f"{name} {known[name]:g}" for name in _QUALITY if known.get(name) is not None),
    ]
    return [*lines, ", ".join(filter(None, words))]


def _text(head: list[str], sections: dict[str, list[Finding]], limits: Limits) -> str:
    lines, parameters = [*head], list[str]()
    for title, findings in sections.items():
        lines += ["", title, *(f"  {one.text}" for one in findings)]
        parameters += [name for one in findings for name in one.parameters]
    if parameters:
        lines += ["", "What would change it", *(f"  {one}" for one in limits.lines(parameters))]
    others = limits.other_changes(parameters)
    if others:
        lines += ["", "Also changed in this run", *(f"  {one}" for one in others)]
    return "\n".join(lines)
