"""Points sorted into grid cells on disk, so that a survey of any size passes through little memory."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.files.captured_stderr import one_line

#: A cell's column and row in the grid.
Cell = tuple[int, int]

#: What is kept of a point: the columns of a tile, map coordinates first.
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
        ("source", "<u2"),
        ("index", "<u4"),
    ]
)

#: Records read back at a time (10 MB).
BLOCK = 262_144
#: Cell numbers up to this sort fastest (radix sort).
_SHORT = 65_536


class Spool:
    """
    One file of records per grid cell, in a temporary folder.

    Parameters
    ----------
    folder : path or None
        Where the temporary folder is made; the system's place for such if None.
    """

    def __init__(self, folder: str | Path | None = None) -> None:
        try:
            self.folder = Path(tempfile.mkdtemp(prefix="lidar_buildings_", dir=folder))
        except OSError as error:
            raise self._full(folder or tempfile.gettempdir(), error) from error
        #: Number of records per cell.
        self.counts: dict[Cell, int] = {}

    def append(self, cells: NDArray[np.int64], records: NDArray[Any]) -> list[Cell]:
        """
        Add records, each to its cell, in their order; return the cells. What cannot be added leaves nothing.

        Parameters
        ----------
        cells : ndarray of shape (n, 2)
            Column and row of each record's cell.
        records : ndarray of `RECORD`, shape (n,)
        """
        if len(records) == 0:
            return []
        order, starts = _grouped(cells)
        records = records.take(order)  # ten times as fast as by index: a record is copied in one piece
        touched: list[Cell] = [(column, row) for column, row in cells[order[starts]].tolist()]
        before = {cell: self.counts.get(cell, 0) for cell in touched}
        try:
            for cell, start, end in zip(touched, starts, [*starts[1:], len(records)], strict=True):
                append_records(self._file(cell), before[cell], records[start:end])
                self.counts[cell] = before[cell] + end - start
        except OSError as error:
            for cell, count in before.items():
                if self.counts.get(cell, 0) > count:
                    os.truncate(self._file(cell), count * RECORD.itemsize)
                    self.counts[cell] = count
            raise self._full(self.folder, error) from error
        return touched

    def blocks(self, cell: Cell, first: int = 0, last: int | None = None) -> Iterator[NDArray[Any]]:
        """Read a cell's records `first` to `last`, some at a time."""
        end = min(self.counts.get(cell, 0), last if last is not None else 2**62)
        while first < end:
            count = min(BLOCK, end - first)
            yield np.fromfile(self._file(cell), RECORD, count, offset=first * RECORD.itemsize)
            first += count

    def remove(self) -> None:
        """Delete everything."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _file(self, cell: Cell) -> Path:
        return self.folder / f"{cell[0]}_{cell[1]}.points"

    @staticmethod
    def _full(folder: str | Path, error: OSError) -> OutputError:
        return OutputError(
            f"{folder}: temporary files cannot be written ({one_line(error)}): "
            "free some space, or set TMPDIR to a folder with more"
        )


def append_records(path: Path, n_before: int, records: NDArray[Any]) -> None:
    """
    Append records to a file that holds so many; what cannot be written whole leaves it as it was.

    Raises
    ------
    OSError
        If they cannot be written.
    """
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
