"""Points sorted into grid cells on disk, so that a survey of any size passes through little memory."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from copy import copy
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.files.atomic_files import writing
from lidar_buildings.io.files.temporary_folder import make_temporary_folder, remove_folder, temporary_files
from lidar_buildings.io.tiling.tile_grid import Cell, CellTable
from lidar_buildings.io.tiling.tile_stamps import gps_time_of

#: What is kept of a point: the columns of a tile, map coordinates first. `take` and `compress` copy records
#: five times as fast as indices do.
RECORD = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("intensity", "<f4"),
        ("return_number", "u1"),
        ("number_of_returns", "u1"),
        ("classification", "u1"),
        ("scan_angle", "<f4"),
        ("scan_direction_flag", "u1"),
        ("point_source_id", "<u2"),
        ("gps_time", "<f8"),
        ("view", "u1"),
        ("source", "<u2"),
        ("index", "<u4"),
    ]
)


class Head(NamedTuple):
    """The first of some points: what orders it, and when it was measured."""

    source: int
    index: int
    gps_time: float


class Piece(NamedTuple):
    """Records of a cell."""

    file: Path  #: where they are
    count: int  #: how many there are, from its beginning
    head: Head | None = None  #: the first one, where that is known


#: Where the records of each cell are, in their order.
Pieces = dict[Cell, list[Piece]]

#: Records read back at a time (10 MB).
BLOCK = 262_144
#: Cell numbers up to this sort fastest (radix sort).
_SHORT = 65_536


class Spool:
    """One file of records per grid cell, in a temporary folder within `folder`, or the system's."""

    def __init__(self, folder: str | Path | None = None) -> None:
        self.folder = make_temporary_folder(folder)
        #: How many records each cell has here, and where those are that were joined.
        self._counts, self._joined = CellTable(0), dict[Cell, list[Piece]]()

    def append(self, cells: NDArray[np.int64], records: NDArray[Any]) -> list[Cell]:
        """Add records to their cells, shape (n, 2); return the cells. What cannot be added leaves nothing."""
        if len(records) == 0:
            return []
        order, starts = _grouped(cells)
        records = records.take(order)
        touched: list[Cell] = [(column, row) for column, row in cells[order[starts]].tolist()]
        before = {cell: int(self._counts[cell]) for cell in touched}
        written = []
        with temporary_files(self.folder):
            try:
                for cell, start, end in zip(touched, starts, [*starts[1:], len(records)], strict=True):
                    append_records(self._file(cell), before[cell], records[start:end])
                    written.append((cell, before[cell] + end - start))
            except OSError:
                for cell, _ in written:
                    os.truncate(self._file(cell), before[cell] * RECORD.itemsize)
                raise
        for cell, count in written:
            self._counts[cell] = count
        return touched

    def join(self, pieces: Pieces) -> list[Cell]:
        """Take what another process's spool holds as being here, behind what is; return its cells."""
        for cell, more in pieces.items():
            self._joined.setdefault(cell, []).extend(more)
        return list(pieces)

    def count(self, cell: Cell) -> int:
        """Return the number of a cell's records."""
        return int(self._counts[cell]) + sum(piece.count for piece in self._joined.get(cell, ()))

    def blocks(self, cell: Cell, first: int = 0, last: int | None = None) -> Iterator[NDArray[Any]]:
        """Read a cell's records `first` to `last`, some at a time."""
        before = 0
        for file, count, _ in self._pieces(cell):
            end = count if last is None else min(last - before, count)
            yield from read_records(file, max(first - before, 0), end)
            before += count

    def heads(self, cell: Cell, first: int, last: int, without: Collection[int]) -> Iterator[Head]:
        """Yield first points of what a cell holds from record `first` to `last`, some sources left out."""
        before = 0
        for piece in self._pieces(cell):
            start, end = max(first - before, 0), min(last - before, piece.count)
            if piece.head is None or (start, end) != (0, piece.count):
                for block in self.blocks(cell, before + start, before + end):
                    records = block.compress(~np.isin(block["source"], list(without))) if without else block
                    if len(records):
                        first_one = records[np.argmin(order_key(records))]
                        yield Head(*(first_one[name].item() for name in Head._fields))
            elif piece.head.source not in without:
                yield piece.head
            before += piece.count

    def with_heads(self) -> Pieces:
        """Return where the records are, in a spool of a single source: the first ones of cells are known."""
        return {
            cell: [piece._replace(head=next(self.heads(cell, 0, 1, ()))) for piece in self._pieces(cell)]
            for cell in self._counts
        }

    def near(self, cells: Iterable[Cell]) -> Spool:
        """Return the same spool as if it held some cells alone: little to send to another process."""
        part = copy(self)
        cells = list(cells)
        part._counts = self._counts.part(cells)
        part._joined = {cell: self._joined[cell] for cell in cells if cell in self._joined}
        return part

    def remove(self) -> None:
        """Delete everything, also what another thread adds meanwhile."""
        remove_folder(self.folder)

    def _pieces(self, cell: Cell) -> list[Piece]:
        count = int(self._counts[cell])
        return [Piece(self._file(cell), count)] * bool(count) + self._joined.get(cell, [])

    def _file(self, cell: Cell) -> Path:
        return self.folder / f"{cell[0]}_{cell[1]}.points"


def order_key(records: NDArray[Any]) -> NDArray[np.uint64]:
    """Return a number that orders records by (source, index)."""
    return records["source"].astype(np.uint64) << np.uint64(32) | records["index"]


def read_records(path: Path, first: int, end: int) -> Iterator[NDArray[Any]]:
    """Read records of a file, some at a time, from the first to that before the end."""
    for start in range(first, end, BLOCK):
        yield np.fromfile(path, RECORD, min(BLOCK, end - start), offset=start * RECORD.itemsize)


def append_records(path: Path, n_before: int, records: NDArray[Any]) -> None:
    """Append records to a file that holds so many; OSError if they do not fit: it stays as it was."""
    try:
        with open(path, "ab", buffering=0) as file:
            content = records.view(np.uint8).data
            if file.write(content) != content.nbytes:  # the disk was full in between
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    except OSError:
        if path.exists():
            os.truncate(path, n_before * RECORD.itemsize)
        raise


def _grouped(cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], list[int]]:
    """Return the order that brings rows of equal cells together, stable, and where each cell begins in it."""
    column, row = cells.T
    n_rows = int(row.max() - row.min()) + 1
    if (int(column.max() - column.min()) + 1) * n_rows <= _SHORT:
        key = ((column - column.min()) * n_rows + (row - row.min())).astype(np.uint16)
    else:
        key = np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)
    order = np.argsort(key, kind="stable")
    sorted_key = key[order]
    starts = np.flatnonzero(np.concatenate([[True], sorted_key[1:] != sorted_key[:-1]]))
    return order, starts.tolist()


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
            with suppress(ValueError):
                found.append(json.loads(line))
        return [event for event in found if isinstance(event, dict)]

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
