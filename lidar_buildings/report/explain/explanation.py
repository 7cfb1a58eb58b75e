"""The text that explains a building, or why there is none at a place."""

from __future__ import annotations

import re

import numpy as np
import shapely

from lidar_buildings.core.model.classes import Facade
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.io.models.cityjson import parse_feature
from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.report.explain.building_findings import line_findings, outline_findings, roof_findings
from lidar_buildings.report.explain.finding import Finding, Limits, read_site
from lidar_buildings.report.explain.rejections import rejected_at, rejected_beside
from lidar_buildings.report.result_folder import GPKG, ReportedBuilding, Result
from lidar_buildings.report.summary_words import early_end

#: A place as X,Y in the source's coordinates.
_PLACE = re.compile(r"\s*([-+]?\d+(?:\.\d*)?)\s*[, ]\s*([-+]?\d+(?:\.\d*)?)\s*")
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

    A name is a building's readable id or the end of it, its number, the name of its footprint, or X,Y.
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
    here = [one for one in result.buildings if one.shape is not None and shapely.contains_xy(one.shape, x, y)]
    return here[0] if here else (x, y)


def explain_building(result: Result, building: ReportedBuilding) -> str:
    """Say why a building has its outline and its roof; InputError if a cloud cannot be read."""
    known, frame = building.attributes, result.frame
    spacing = (known.get("point_spacing") or 0.0) * frame.horizontal_unit or _SPACING
    limits = Limits(result.run, spacing)
    sections: dict[str, list[Finding]] = {}
    sections["Outline"] = list(outline_findings(building, spacing, limits))
    if building.shape is not None and not building.shape.is_empty and result.clouds():
        site = read_site(result.clouds(), frame, Rectangle(*building.shape.bounds).grown(3.0))
        number = building.building_id
        roof = site.select((site.building_id == number) & (site.facade == Facade.NONE) & (number > 0))
        is_top = (site.building_id == number) & (site.facade == Facade.BARE)
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
                sections["Roof"] += line_findings(result.folder / GPKG, building.name, frame.horizontal_unit)
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
    if known.get("reason"):
        lines.append(f"reason: {known['reason']}")
    words = [
        f"roof {known['roof_type']}" if known.get("roof_type") else "",
        f"LoD{known['lod']}" if known.get("lod") else "no solid",
        f"validity {known['validity']}" if known.get("validity") not in (None, "", "[]") else "",
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
