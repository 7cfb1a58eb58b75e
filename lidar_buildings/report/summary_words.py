"""What a result is in words and numbers: the lines at the top of a page, its tables, its histograms."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.grade import Grade, causes_in
from lidar_buildings.core.model.parameters import spec_of
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.io.results.output_config import OutputConfig
from lidar_buildings.io.results.run_summary import counted
from lidar_buildings.io.tiling.tiling_config import TilingConfig
from lidar_buildings.pipeline.config import STAGE_CONFIGS
from lidar_buildings.report.result_folder import GPKG, ReportedBuilding, Result

#: Attribute → what its histogram is called, and its unit.
HISTOGRAMS = {
    "rmse": ("Distance of points to models (rmse)", " m"),
    "outline_sigma": ("Distance of traced points to outlines (σ)", " m"),
    "coverage": ("Share of the outline that points support", ""),
}
_MOST_BINS = 24
#: Widths of bins, of which the finest is taken that needs no more bins.
_STEPS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
#: Bins end where so many percent of the values do; those beyond are counted apart.
_LAST = 98.0
#: Attribute → power of the unit of length.
_SIZES = (("area", 2), ("volume", 3))
_KINDS = {
    "ground": (PointClass.GROUND, PointClass.ROAD_SURFACE, PointClass.WATER, PointClass.RAIL),
    "buildings": (PointClass.BUILDING,),
    "vegetation": (PointClass.LOW_VEGETATION, PointClass.MEDIUM_VEGETATION, PointClass.HIGH_VEGETATION),
    "noise": (PointClass.LOW_NOISE, PointClass.HIGH_NOISE),
}


def headlines(result: Result) -> dict[str, str]:
    """Return the five lines: what came in, how it was classified, what came out, how sure, how long."""
    return {
        "In": _came_in(result),
        "Points": _points(result.run),
        "Out": _came_out(result),
        "How sure": _how_sure(result),
        "How long": _how_long(result.run),
    }


def problems(run: Mapping[str, Any]) -> list[str]:
    """Return what went wrong, one line each: inputs, tiles, points."""
    lines = [str(one) for one in run.get("problems", ())]
    lines += [f"tile {one['tile']} failed: {one['reason']}" for one in run.get("failed_tiles", ())]
    if run.get("n_unclassified"):
        lines.append(f"{run['n_unclassified']:,} points are in no finished tile and kept their class")
    return lines


def remarks(run: Mapping[str, Any]) -> list[str]:
    """Return what can hardly be so, or is not there, one line each."""
    return [str(one["text"] if isinstance(one, Mapping) else one) for one in run.get("remarks", ())]


def early_end(run: Mapping[str, Any]) -> str:
    """Say that a run was told to end before the last stage; empty if it was not."""
    if run.get("until") in (None, STAGES[-1]):
        return ""
    return f"The run ended after {run['until']} (--until): there are no results of later stages."


def notes(result: Result) -> list[str]:
    """Return what a page lacks, and why."""
    run, lines = result.run, []
    ended = early_end(run)
    if ended:
        lines.append(ended)
    elif not result.buildings:
        lines.append("No building was found.")
    if result.buildings and not result.has(GPKG):
        lines.append("There is no buildings.gpkg, so the map shows no outlines.")
    if not run.get("rasters"):
        lines.append("There are no rasters, so the terrain is not shown.")
    return lines


def stage_seconds(run: Mapping[str, Any]) -> list[tuple[str, float]]:
    """Return what each stage took, in the order of the run [s]."""
    seconds = run.get("seconds", {})
    return [(stage, float(seconds[stage])) for stage in STAGES if stage in seconds]


def changed_parameters(run: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return (stage.parameter, value, default) of what differs from the defaults."""
    told = run.get("parameters", {})
    changed = []
    configs = {**STAGE_CONFIGS, TilingConfig.stage: TilingConfig, OutputConfig.stage: OutputConfig}
    for stage, config in configs.items():
        given = told.get(stage)
        for one in fields(config) if isinstance(given, dict) else ():
            default = list(one.default) if isinstance(one.default, tuple) else one.default
            value = given.get(one.name, default)
            value = list(value) if isinstance(value, tuple) else value
            if value != default:
                unit = spec_of(one).unit
                changed.append((f"{stage}.{one.name}", _written(value, unit), _written(default, unit)))
    return changed


def histograms(result: Result) -> list[dict[str, Any]]:
    """Return counts per bin of what tells how good the buildings are, and how many lie beyond the last."""
    found = []
    for name, (title, unit) in HISTOGRAMS.items():
        values = _values(result, name)
        if not len(values):
            continue
        most = 1.0 if name == "coverage" else float(np.percentile(values, _LAST))
        low = float(values.min()) if name == "coverage" else 0.0
        step = next((one for one in _STEPS if most - low <= _MOST_BINS * one), (most - low) / _MOST_BINS)
        first = math.floor(low / step + 1e-6)
        edges = np.arange(first, max(math.ceil(most / step - 1e-6), first + 1) + 1) * step
        values = np.round(values, 6)  # so that an edge's own multiples fall where they belong
        beyond = int((values > round(edges[-1], 6)).sum())
        counts, _ = np.histogram(values[values <= round(edges[-1], 6)], np.round(edges, 6))
        known = {"from": float(edges[0]), "step": step, "beyond": beyond, "median": float(np.median(values))}
        found.append({"title": title, "unit": unit, "counts": counts.tolist(), **known})
    return found


class Figure(NamedTuple):
    """One of the numbers that a page begins with."""

    title: str
    value: str
    more: str
    shares: Mapping[str, int] = {}  #: grade → buildings


def figures(result: Result) -> list[Figure]:
    """Return buildings, area and volume, seen walls, grades, accuracy: those that are known."""
    buildings = result.buildings
    n_solids = sum(bool(one.attributes.get("lod")) for one in buildings)
    valid = f"{_n_valid(buildings):,} with valid solids" if n_solids else "outlines alone"
    found = [Figure("Buildings", f"{len(buildings):,}", valid if buildings else "none was found")]
    area, volume = (_values(result, name).sum() * result.unit**power for name, power in _SIZES)
    if area:
        found.append(
            Figure("Footprints and volume", f"{area:,.0f} m²", f"{volume:,.0f} m³" if volume else "")
        )
    if n_walls := result.run.get("facade_count"):
        length = f"{result.run.get('facade_length', 0.0):,.0f} m"
        found.append(Figure("Seen walls", length, f"{counted(n_walls, 'façade')} from the street"))
    counts = Counter(one.quality for one in buildings)
    grades = {grade.value: counts[grade.value] for grade in Grade if counts[grade.value]}
    if grades:
        good = Grade.GOOD.value
        rest = ", ".join(f"{n:,} {name}" for name, n in grades.items() if name != good)
        found.append(Figure("Grades", f"{counts[good]:,} {good}", rest, grades))
    off = _values(result, "rmse")
    if len(off):
        worse = f"points off the models; 90 % below {np.percentile(off, 90):.2f} m"
        found.append(Figure("Accuracy", f"{np.median(off):.2f} m", worse))
    return found


def _written(value: Any, unit: str) -> str:
    text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
    return f"{text} {unit}".strip()


def _came_in(result: Result) -> str:
    run = result.run
    inputs = run.get("inputs", ())
    names = ", ".join(Path(one["path"]).name for one in inputs[:3]) + (", …" if len(inputs) > 3 else "")
    raster = next(iter(run.get("rasters", {}).values()), None)
    words = [f"{run.get('n_points', 0):,} points in {counted(len(inputs), 'file')} ({names})"]
    words.append(result.frame.crs.split(",")[0] or "no reference system named")
    if raster:
        side = raster["cell"] * result.frame.horizontal_unit
        area = raster["known_cells"] * side**2
        density = run.get("n_points", 0) / max(area, 1.0)
        words.append(f"{area / 10_000:,.1f} ha with points, {density:.1f} points/m²")
    return "; ".join(words)


def _points(run: Mapping[str, Any]) -> str:
    classes = {int(code): n for code, n in run.get("classes", {}).items()}
    total = sum(classes.values())
    if not total:
        return "none was classified"
    shares = {kind: sum(classes.get(code, 0) for code in codes) / total for kind, codes in _KINDS.items()}
    shares["other"] = 1.0 - sum(shares.values())
    return ", ".join(f"{share:.1%} {kind}" for kind, share in shares.items() if share >= 0.0005)


def _came_out(result: Result) -> str:
    if not result.buildings:
        return "no buildings"
    grades = Counter(one.quality for one in result.buildings if one.quality)
    kinds = grades or Counter(one.status for one in result.buildings)
    counts = ", ".join(f"{n:,} {kind}" for kind, n in kinds.most_common())
    words = [f"{counted(len(result.buildings), 'building')} ({counts})"]
    failed = Counter(one.status for one in result.buildings if one.status != BuildingStatus.OK.value)
    if grades and failed:
        words.append("status: " + ", ".join(f"{n:,} {status}" for status, n in failed.most_common()))
    levels = Counter(one.attributes.get("lod") or "" for one in result.buildings)
    if levels.keys() - {""}:
        ordered = sorted(levels.items(), reverse=True)
        words.append(
            ", ".join(f"{n:,} {f'with LoD{lod}' if lod else 'without a solid'}" for lod, n in ordered)
        )
        roofs = Counter(one.attributes.get("roof_type") or "unknown" for one in result.buildings)
        words.append("roofs: " + ", ".join(f"{n:,} {kind}" for kind, n in roofs.most_common()))
    return "; ".join(words)


def _how_sure(result: Result) -> str:
    words = []
    for name, text, tail in (
        ("rmse", "points lie {:.3f} m off the models (median of rmse; 90 %: {:.3f} m)", 90),
        ("outline_sigma", "traced points {:.2f} m off the outlines (90 %: {:.2f} m)", 90),
        ("coverage", "{:.1%} of outlines supported by points (10 %: {:.1%})", 10),
    ):
        values = _values(result, name)
        if len(values):
            words.append(text.format(float(np.median(values)), float(np.percentile(values, tail))))
    causes = Counter(cause for one in result.buildings for cause in causes_in(one.quality_reasons))
    if causes:
        words.append("doubts: " + ", ".join(f"{n:,} {cause}" for cause, n in causes.most_common()))
    if any(one.attributes.get("lod") for one in result.buildings):
        words.append(f"{_n_valid(result.buildings):,} of {len(result.buildings):,} with valid solids")
    return "; ".join(words) or "nothing to measure"


def _n_valid(buildings: Iterable[ReportedBuilding]) -> int:
    return sum(one.attributes.get("validity") in ("[]", []) for one in buildings)


def _how_long(run: Mapping[str, Any]) -> str:
    seconds, stages = run.get("seconds", {}), stage_seconds(run)
    words = []
    if "wall" in seconds:
        rate = run.get("n_points", 0) / max(seconds["wall"], 1e-3)
        words.append(f"{seconds['wall']:,.1f} s, {rate:,.0f} points/s")
    words.append(counted(run.get("n_tiles", 0), "tile"))
    if stages:
        name, most = max(stages, key=lambda one: one[1])
        total = sum(taken for _, taken in stages)
        words.append(f"most of it {name} ({most:,.1f} s of {total:,.1f} s in stages)")
    versions = run.get("versions", {})
    if "lidar_buildings" in versions:
        words.append(f"lidar_buildings {versions['lidar_buildings']}")
    return "; ".join(words)


def _values(result: Result, name: str) -> NDArray[np.float64]:
    """Return an attribute of all buildings that have it, lengths in metres."""
    unit = result.unit if name in ("rmse", "outline_sigma") else 1.0
    found = [one.attributes.get(name) for one in result.buildings]
    return np.array([value for value in found if value is not None], np.float64) * unit
