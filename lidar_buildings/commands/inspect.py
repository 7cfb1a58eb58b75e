"""The command ``lidar-buildings inspect``: what files and bags hold, and what a run would make of them."""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidar_buildings.core.model.classes import CLASS_NAMES
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.exit_status import ExitStatus
from lidar_buildings.io.bags.bag_inputs import is_bag, is_bag_file
from lidar_buildings.io.clouds.find_inputs import is_cloud_file, named_by
from lidar_buildings.io.files.locations import located
from lidar_buildings.io.results.run_summary import counted
from lidar_buildings.io.tiling.cloud_summary import CloudSummary, summarise_cloud, summed_up

if TYPE_CHECKING:
    from lidar_buildings.io.bags.bag_summary import BagSummary

#: How a density was measured, in words.
_MEASURES = {
    "spacing": "measured in the middle",
    "bounds": "pulses by the area of the bounds",
    "files": "mean of the files",
}


def inspect_command(options: argparse.Namespace) -> int:
    """Print what every input holds; return 0, or 2 if one could not be read to its end, said on stderr."""
    logging.basicConfig(format="lidar-buildings: %(message)s", level=logging.WARNING)
    problems: list[str] = []
    told: list[dict[str, Any]] = []
    for name in options.input:
        for kind, summary, lines in _looked_at(name, problems):
            if options.json:
                told.append({"kind": kind, **summary})
            else:
                print("\n".join(lines), flush=True)
    if options.json:
        print(json.dumps(told, indent=2))
    for problem in problems:
        print(f"lidar-buildings: {problem}", file=sys.stderr)
    return ExitStatus.WRONG_USE if problems else ExitStatus.DONE


def _looked_at(name: str, problems: list[str]) -> Iterator[tuple[str, dict[str, Any], list[str]]]:
    """Yield (kind, summary, its text) of each bag and cloud that a path names, and of its clouds together."""
    clouds: list[CloudSummary] = []
    try:
        path = located(name)
        files = _named(path)
    except InputError as error:
        problems.append(str(error))
        return
    for file in files:
        try:
            if is_bag(file):
                yield _bag(file, problems)
            else:
                clouds.append(summarise_cloud(file))
                yield "cloud", asdict(clouds[-1]), cloud_lines(clouds[-1])
        except InputError as error:
            problems.append(str(error))
    if len(clouds) > 1:
        total = summed_up(str(path), clouds)
        yield "sum", asdict(total), cloud_lines(total)


def _bag(path: Path, problems: list[str]) -> tuple[str, dict[str, Any], list[str]]:
    from lidar_buildings.io.bags.bag_summary import summarise_bag  # what reads bags takes time to import

    found = summarise_bag(path)
    if found.problem:
        problems.append(f"{path}: {found.problem}")
    taken = None if found.taken is None else found.taken._asdict()
    topics = [one._asdict() for one in found.topics]
    return "bag", {**found._asdict(), "topics": topics, "taken": taken}, bag_lines(found)


def _named(path: Path) -> list[Path]:
    within = [path] if is_bag(path) else named_by(path)
    kinds = is_cloud_file, is_bag_file, is_bag
    found = sorted(one for one in within if one == path or any(is_kind(one) for is_kind in kinds))
    if not found:
        raise InputError(
            f"{path}: contains no point cloud (.las, .laz) and no bag: give another folder, or files"
        )
    return found


def cloud_lines(found: CloudSummary) -> list[str]:
    """Return the block of a cloud, or of several."""
    head = found.format or counted(found.n_files, "file")
    lines = [f"{found.path}: {head}, {counted(found.n_points, 'point')}"]
    if not found.n_points:
        return lines
    system = found.crs.split(",")[0] or "none in the file"
    units = (
        "" if found.units == [1.0, 1.0] else f" (units of {found.units[0]:g} m, heights {found.units[1]:g} m)"
    )
    rows = {
        "system": f"{system}{units}",
        "extent": _extent(found),
        "density": f"{found.density:.3g} pulses/m², spacing {found.point_spacing:.2f} m "
        f"({_MEASURES[found.density_from]}); {counted(found.n_pulses, 'pulse')}"
        if found.density
        else "none: the points span no area",
        "returns": _counts(found.returns, {0: "not known"}, "of "),
        "classes": _counts(found.classes, CLASS_NAMES, ""),
        "withheld": f"{found.n_withheld:,}" if found.n_withheld else "",
        "times": " to ".join(found.times) or ("" if found.n_files > 1 else "none"),
        "strips": f"{found.n_strips:,}" if found.n_strips else "",
    }
    return [*lines, *(f"  {name:8} {text}" for name, text in rows.items() if text)]


def bag_lines(found: BagSummary) -> list[str]:
    """Return the block of a bag."""
    when = ""
    if found.start is not None:
        moment = datetime.fromtimestamp(found.start // 1_000_000_000, tz=timezone.utc)
        when = f", from {moment:%Y-%m-%d %H:%M:%S} UTC"
    n_messages = sum(one.n_messages for one in found.topics)
    lines = [f"{found.path}: bag of {found.seconds:.1f} s{when}, {counted(n_messages, 'message')}"]
    lines += [f"  {one}" for one in found.topics]
    if found.taken is not None:
        taken = found.taken
        poses = [*filter(None, [taken.odometry]), *taken.transforms]
        lines.append(f"  a run takes: scans {taken.clouds}, poses {', '.join(poses) or 'none'}")
    return lines + [f"  {note}" for note in found.notes]


def _extent(found: CloudSummary) -> str:
    spans = [f"{low:.2f} to {high:.2f}" for low, high in zip(found.mins, found.maxs, strict=True)]
    width, depth, height = found.size
    return f"x {spans[0]}, y {spans[1]}, z {spans[2]}: {width:,.0f} × {depth:,.0f} × {height:,.0f} m"


def _counts(counts: Mapping[int, int], names: Mapping[int, str], before: str) -> str:
    return ", ".join(
        f"{names.get(number, f'{before}{number}' if before else 'other')}"
        f"{f' ({number})' if not before else ''}: {n:,}"
        for number, n in counts.items()
    )
