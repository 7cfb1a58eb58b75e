"""Bags among inputs: their scans are placed first, and then read like any other cloud."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.placing import NO_POSE, WHY_NO_POSE
from lidar_buildings.io.bags import bags_among, bags_of
from lidar_buildings.io.bags.bag_config import NO_SCAN, BagConfig


def with_clouds(inputs: Sequence[str], folder: Path) -> tuple[str, ...]:
    """Return inputs with the clouds that `place_bags` makes in a folder instead of the bags."""
    paths = {bag: str(_cloud(folder, number, bag)) for number, bag in enumerate(bags_among(inputs))}
    with_bags = ([paths[bag.resolve()] for bag in bags_of(one)] or [one] for one in inputs)
    return tuple(dict.fromkeys(path for named in with_bags for path in named))


def place_bags(
    inputs: Sequence[str], folder: Path, choice: BagConfig, config: ScanConfig, tell: Callable[[str], None]
) -> list[dict[str, Any]]:
    """
    Make a LAZ file of each bag among inputs, but for those that are there from an earlier time.

    Each is made in a folder of its own, as bags of different places may have one name. `tell` is called with
    one line for each bag that was placed. Returned is what was read, placed and left out of each bag.
    InputError or OutputError if a bag cannot be read or placed, a file not be written, or all of the bags
    have no scan in the part that is chosen.
    """
    bags = bags_among(inputs)
    records = [
        _placed(bag, _cloud(folder, number, bag), choice, config, tell) for number, bag in enumerate(bags)
    ]
    if choice.start or choice.duration:
        empty = [bag for bag, one in zip(bags, records, strict=True) if not one["n_scans"]]
        if empty and len(empty) == len(bags):
            raise InputError(f"{', '.join(map(str, empty))}: {NO_SCAN}")
        for bag in empty:
            tell(f"{bag}: warning: {NO_SCAN}")
    return records


def _cloud(folder: Path, number: int, bag: Path) -> Path:
    return folder / str(number) / f"{bag.name if bag.is_dir() else bag.stem}.laz"


def _placed(
    bag: Path, path: Path, choice: BagConfig, config: ScanConfig, tell: Callable[[str], None]
) -> dict[str, Any]:
    """Place a bag's scans unless that is done; return the record of it."""
    from lidar_buildings.io.bags.placed_cloud import write_placed  # what reads bags takes time to import

    note = path.parent / "record.json"
    wanted = {one.name: getattr(choice, one.name) for one in fields(BagConfig)}
    wanted |= {"bag": str(bag), "changed": _changed(bag), **asdict(config)}
    if path.exists() and note.exists():
        record: dict[str, Any] = json.loads(note.read_text())
        if {name: record.get(name) for name in wanted} == wanted:
            return record
    path.parent.mkdir(parents=True, exist_ok=True)
    count = write_placed(bag, path, choice, config)
    record = wanted | count._asdict()
    note.write_text(json.dumps(record))
    tell(_line(bag, record))
    for said in filter(None, [count.place, *(f"warning: {one}" for one in count.warnings)]):
        tell(f"{bag}: {said}")
    return record


def _changed(bag: Path) -> int:
    """Return when a bag was changed last [ns]."""
    files = [bag, *bag.iterdir()] if bag.is_dir() else [bag]
    return max(file.stat().st_mtime_ns for file in files)


def _line(bag: Path, record: dict[str, Any]) -> str:
    out = "".join(f"; {number:,} left out: {reason}" for reason, number in record["left_out"].items())
    said = "".join(f"; {number:,} {what}" for what, number in record["messages"].items())
    problem = f"; {record['problem']}" if record["problem"] else ""
    line = f"{bag}: {record['n_points']:,} points of {record['n_scans']:,} scans placed{out}{said}{problem}"
    if record["left_out"].get(NO_POSE, 0) <= record["n_points"]:
        return line
    return f"{line} ({WHY_NO_POSE})"
