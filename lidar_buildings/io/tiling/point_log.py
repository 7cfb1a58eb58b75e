"""All points of a feed in the order in which they came, on disk: what an interrupted feed goes on with."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.files.atomic_files import writing
from lidar_buildings.io.tiling.spool import RECORD, append_records, read_records
from lidar_buildings.io.tiling.tile_stamps import gps_time_of

_POINTS, _EVENTS = "points.log", "tiles.jsonl"


class PointLog:
    """
    Records one after the other, and what became of tiles as lines of JSON beside them.

    What the folder holds is gone on with; `count` is the number of records. OutputError if it cannot be used.
    """

    def __init__(self, folder: Path) -> None:
        self._points, self._events = folder / _POINTS, folder / _EVENTS
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            self._points.touch()
            self.count = self._points.stat().st_size // RECORD.itemsize
            self.take_back(0)  # a process that was killed leaves a part of one

    def append(self, records: NDArray[Any]) -> None:
        """Add records; OutputError if they cannot be written: then none is."""
        with writing(self._points):
            append_records(self._points, self.count, records)
        self.count += len(records)

    def take_back(self, n_records: int) -> None:
        """Remove the last records."""
        self.count -= n_records
        os.truncate(self._points, self.count * RECORD.itemsize)

    def blocks(self, first: int = 0, last: int | None = None) -> Iterator[NDArray[Any]]:
        """Read the records `first` to `last`, some at a time."""
        return read_records(self._points, first, self.count if last is None else min(last, self.count))

    def note(self, event: dict[str, Any]) -> None:
        """Add an event; OutputError if it cannot be written."""
        with writing(self._events), open(self._events, "a", encoding="utf-8") as file:
            file.write(json.dumps(event) + "\n")

    def events(self) -> list[dict[str, Any]]:
        """Return the events; a line that was cut off is none."""
        found = []
        for line in self._events.read_text(encoding="utf-8").splitlines() if self._events.exists() else ():
            try:
                event = json.loads(line)
            except ValueError:
                continue
            if isinstance(event, dict):
                found.append(event)
        return found

    def clear(self) -> None:
        """Forget all."""
        self.take_back(self.count)
        self._events.unlink(missing_ok=True)


def records_of(scan: PlacedScan) -> NDArray[Any]:
    """Return a scan's points as they are kept."""
    records = np.zeros(len(scan.points), RECORD)
    records["x"], records["y"], records["z"] = scan.points.T
    records["classification"] = 1
    records["gps_time"] = gps_time_of(scan.times)
    for name, values in scan.columns.items():
        records[name] = values
    return records
