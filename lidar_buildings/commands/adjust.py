"""The command ``lidar-buildings adjust``: strips that overlap, and copies in which they lie on each other."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import ExitStatus, InputError, OutputError, ParameterError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.neighbours.cell_grid import cell_numbers
from lidar_buildings.core.surfaces.intensity import BRIGHTEST, normalised_intensity, strip_scales
from lidar_buildings.core.surfaces.strip_adjustment import BLOCK, StripAdjustment, adjust_strips
from lidar_buildings.io.clouds.classified_las import suffix_for, write_changed
from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.clouds.find_inputs import InputFile
from lidar_buildings.io.clouds.las import frame_of, open_inputs
from lidar_buildings.io.clouds.point_columns import point_columns, xyz_of
from lidar_buildings.io.files.atomic_files import atomic_file, atomic_folder
from lidar_buildings.io.files.failures import log_to_terminal
from lidar_buildings.io.results.run_folder import output_names
from lidar_buildings.io.tiling.survey_brightness import only_returns

#: Points that are compared at most, about: of more, blocks are left out.
_MOST = 20_000_000
#: Intensities by which strips are stretched, about, of each file.
_SAMPLE = 200_000
#: A pair lies farther apart than before if by so much: twice what noise leaves of heights [m].
_WORSE = 0.02
#: What is said of a run in the folder of the copies.
RECORD = "adjustment.json"


@dataclass(frozen=True, eq=False)
class _Survey:
    frame: MapFrame
    points: NDArray[np.float64]
    strip: NDArray[np.int64]
    scales: dict[int, Any]


def adjust_command(options: argparse.Namespace) -> int:
    """
    Print how far strips lie apart, before and after; with ``--output`` write copies with them shifted.

    InputError if a file cannot be read or all points are of one strip; OutputError if the folder exists.
    """
    log_to_terminal()
    least = options.min_intensity
    if not 0.0 <= least <= BRIGHTEST:
        raise ParameterError(f"adjust --min-intensity {least:g}: must be within 0 to {BRIGHTEST:g}")
    if least and not options.output:
        raise ParameterError("adjust --min-intensity: needs --output, a folder for the copies")
    if options.output and options.output.exists():
        raise OutputError(f"{options.output}: exists: give another folder")
    clouds, problems = open_inputs(options.input)
    if problems:
        raise InputError(*problems)
    clouds = [cloud for cloud in clouds if cloud.point_count]
    survey = _read(clouds) if clouds else None
    if survey is None or len(np.unique(survey.strip)) < 2:
        raise InputError(
            f"{options.input[0]}: all points are of one strip: strips are told apart by point_source_id"
        )
    found = adjust_strips(survey.points, survey.strip)
    record = record_of(found)
    if options.output:
        with atomic_folder(options.output) as folder:
            record["weak_points"] = _write(clouds, survey, found, least, folder)
            with atomic_file(folder / RECORD) as temporary:
                temporary.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(record, indent=2) if options.json else "\n".join(_lines(record)))
    return ExitStatus.DONE


def _read(clouds: Sequence[Cloud]) -> _Survey:
    """Read points and strips; of many points blocks that are spread over the survey."""
    frame = frame_of(list(clouds))
    share = _MOST / max(sum(cloud.point_count for cloud in clouds), 1)
    points, strips, samples = [np.empty((0, 3))], [np.empty(0, dtype=np.int64)], []
    for cloud in clouds:
        step = math.ceil(cloud.point_count / _SAMPLE)
        for chunk in cloud.chunks():
            xyz, columns = frame.to_map(xyz_of(chunk)), point_columns(chunk)
            samples.append({name: column[::step] for name, column in columns.items()})
            kept = np.isfinite(xyz).all(axis=1) & ~np.isin(columns["classification"], (7, 18))
            if share < 1.0:
                kept &= (cell_numbers(xyz, BLOCK) * 0.6180339887498949) % 1.0 <= share
            points.append(xyz[kept])
            strips.append(columns["point_source_id"][kept].astype(np.int64))
    names = ("intensity", "point_source_id", "return_number", "number_of_returns")
    of = {name: np.concatenate([one[name] for one in samples] or [np.empty(0)]) for name in names}
    scales = strip_scales(of["intensity"], of["point_source_id"].astype(np.int64), only_returns(of))
    return _Survey(frame, np.concatenate(points), np.concatenate(strips), scales)


def _write(
    clouds: Sequence[Cloud], survey: _Survey, found: StripAdjustment, least: float, folder: Path
) -> int:
    """Write the copies; return how many points have a signal weaker than the least."""
    shift = found.shift / survey.frame.units
    n_weak = 0

    def change(chunk: laspy.ScaleAwarePointRecord) -> None:
        nonlocal n_weak
        strip = np.asarray(chunk.point_source_id, dtype=np.int64)
        row = np.minimum(np.searchsorted(found.strips, strip), len(found.strips) - 1)
        own = np.where((found.strips[row] == strip)[:, None], shift[row], 0.0)
        for axis, name in enumerate("XYZ"):
            chunk.array[name] += np.rint(own[:, axis] / chunk.scales[axis]).astype(np.int32)
        if least:
            intensity = chunk.array["intensity"].astype(np.float32)
            weak = normalised_intensity(intensity, strip, survey.scales) < least
            n_weak += int(np.count_nonzero(weak))
            chunk.withheld = np.asarray(chunk.withheld, dtype=bool) | weak

    names = output_names([InputFile(cloud.path, cloud.point_count) for cloud in clouds])
    for cloud, name in zip(clouds, names, strict=True):
        write_changed(cloud, change, folder / f"{name}{suffix_for(cloud)}")
    return n_weak


def record_of(found: StripAdjustment) -> dict[str, Any]:
    """Return shifts, their standard errors, and residuals for JSON [m]; None for what is unknown."""
    strips = [
        {"strip": int(number), "shift": _known(shift), "plan_error": plan, "height_error": height}
        for number, shift, (plan, height) in zip(
            found.strips, found.shift, map(_known, found.error), strict=True
        )
    ]
    pairs = [
        {
            "strips": [one.first, one.second],
            "before": dict(zip(one.before._fields, _known(one.before), strict=True)),
            "after": dict(zip(one.after._fields, _known(one.after), strict=True)),
        }
        for one in found.pairs
    ]
    return {"strips": strips, "pairs": pairs}


def _known(values: Any) -> list[Any]:
    return [
        None if not math.isfinite(one) else round(float(one), 5) if isinstance(one, float) else one
        for one in (values.tolist() if isinstance(values, np.ndarray) else values)
    ]


def _lines(record: dict[str, Any]) -> list[str]:
    lines = [f"strips: {len(record['strips'])}, pairs that overlap: {len(record['pairs'])}"]
    for pair in record["pairs"]:
        before, after = pair["before"], pair["after"]
        names = ("height", "rms_level", "rms_sloping")
        height, level, sloping = (f"{_metres(before[one])} → {_metres(after[one])}" for one in names)
        counts = f"{after['n_level']:,} level planes", f"{after['n_sloping']:,} sloping ones"
        lines.append(
            f"pair {pair['strips'][0]} {pair['strips'][1]}: height {height} m; RMS {level} m of {counts[0]}, "
            f"{sloping} m of {counts[1]}"
        )
    if worse := [pair["strips"] for pair in record["pairs"] if _is_worse(pair)]:
        named = ", ".join(f"{one} {other}" for one, other in worse)
        lines.append(
            f"farther apart than before: {named}: overlaps contradict one another; a strip may be "
            "bent, or no flight strip, as point_source_id 0 may be"
        )
    for one in record["strips"]:
        x, y, z = one["shift"]
        plan = "plan not told" if one["plan_error"] is None else f"± {one['plan_error']:.3f} in plan"
        height = (
            "height not told" if one["height_error"] is None else f"± {one['height_error']:.3f} in height"
        )
        lines.append(f"strip {one['strip']}: {x:+.3f} {y:+.3f} {z:+.3f} m ({plan}, {height})")
    if record.get("weak_points"):
        lines.append(f"withheld for their weak signal: {record['weak_points']:,} points")
    return lines


def _is_worse(pair: dict[str, Any]) -> bool:
    before, after = (pair[when]["height"] for when in ("before", "after"))
    return before is not None and after is not None and abs(after) > abs(before) + _WORSE


def _metres(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
