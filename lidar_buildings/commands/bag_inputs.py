"""Bags among the inputs of a run: their scans are placed first, and then read like any other cloud."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidar_buildings.commands.run_request import RunRequest
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.io.bags import is_bag
from lidar_buildings.io.results.run_folder import PARTIAL, PLACED, check_folder

if TYPE_CHECKING:
    from lidar_buildings.io.bags.placed_cloud import BagChoice

#: Options of the command line that say what of a bag is wanted.
_OPTIONS = ("topic", "odometry", "start", "duration", "georeferenced")


def with_placed_bags(request: RunRequest, options: argparse.Namespace) -> RunRequest:
    """
    Return the request with a LAZ file for each bag.

    The files stand among the unfinished tiles of the output folder, and go with them; an interrupted run goes
    on with those that are there.

    Raises
    ------
    ParameterError
        If an option of bags is given and no input is one.
    InputError, OutputError
        If a bag cannot be read or placed, or the output folder not used.
    """
    bags = [one for one in request.inputs if is_bag(one)]
    if not bags:
        given = [f"--{one}" for one in _OPTIONS if getattr(options, one)]
        if given:
            raise ParameterError(f"{', '.join(given)}: says what of a bag is wanted, and no INPUT is one")
        return request
    from lidar_buildings.io.bags.placed_cloud import BagChoice  # what reads bags takes time to import

    choice = BagChoice(options.topic or "", options.odometry or "", options.start, options.duration)
    check_folder(request.output, overwrite=request.overwrite)
    folder = request.output / PARTIAL / PLACED
    # a folder each, since bags of different places may have one name
    placed = {
        bag: _placed(bag, folder / str(number), choice, request.scans)
        for number, bag in enumerate(dict.fromkeys(Path(one).resolve() for one in bags))
    }
    inputs = tuple(str(placed[Path(one).resolve()][0]) if one in bags else one for one in request.inputs)
    return replace(request, inputs=inputs, bags=tuple(record for _, record in placed.values()))


def _placed(bag: Path, folder: Path, choice: BagChoice, config: ScanConfig) -> tuple[Path, dict[str, Any]]:
    """Place a bag's scans unless that is done; return the file and the record of it."""
    from lidar_buildings.io.bags.placed_cloud import write_placed

    path = folder / f"{bag.name if bag.is_dir() else bag.stem}.laz"
    note = folder / "record.json"
    wanted = {"bag": str(bag), "changed": _changed(bag), **asdict(choice), **asdict(config)}
    if path.exists() and note.exists():
        record: dict[str, Any] = json.loads(note.read_text())
        if {name: record.get(name) for name in wanted} == wanted:
            return path, record
    folder.mkdir(parents=True, exist_ok=True)
    count = write_placed(bag, path, choice, config)
    record = wanted | {
        "n_scans": count.n_scans,
        "n_points": count.n_points,
        "left_out": dict(sorted(count.left_out.items())),
        "messages": dict(sorted(count.messages.items())),
    }
    note.write_text(json.dumps(record))
    print(f"lidar-buildings: {_line(bag, record)}", file=sys.stderr)
    return path, record


def _changed(bag: Path) -> int:
    """Return when a bag was changed last [ns]."""
    files = [bag, *bag.iterdir()] if bag.is_dir() else [bag]
    return max(file.stat().st_mtime_ns for file in files)


def _line(bag: Path, record: dict[str, Any]) -> str:
    out = "".join(f"; {number:,} left out: {reason}" for reason, number in record["left_out"].items())
    said = "".join(f"; {number:,} {what}" for what, number in record["messages"].items())
    return f"{bag}: {record['n_points']:,} points of {record['n_scans']:,} scans placed{out}{said}"
