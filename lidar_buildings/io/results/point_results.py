"""The results of all tiles, laid out in the point order of one input file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.results.tile_products import load_rows

#: What is known of a point; `known` is 0 for points that no finished tile holds.
RESULT = np.dtype(
    [
        ("known", "u1"),
        ("classification", "u1"),
        ("height_above_ground", "<f4"),
        ("facade", "u1"),
        ("building_id", "<u4"),
        ("plane_id", "<u2"),
        ("edge", "u1"),
    ]
)
#: Records written at a time when the table is made (13 MB).
_BLOCK = 1 << 20


class PointResults:
    """
    A table on disk, one row per point of an input file.

    Parameters
    ----------
    path : Path
        Where the table is made.
    n_points : int
        Points of the input.
    """

    def __init__(self, path: Path, n_points: int) -> None:
        self._path = path
        # written in full before it is mapped: a full disk is then an error, not a bus error
        with atomic_file(path) as temporary, open(temporary, "wb") as file:
            for start in range(0, n_points, _BLOCK):
                file.write(bytes(min(_BLOCK, n_points - start) * RESULT.itemsize))
        self._table: NDArray[Any] = (
            np.memmap(path, RESULT, mode="r+", shape=(n_points,)) if n_points else np.zeros(0, RESULT)
        )

    def __enter__(self) -> PointResults:
        return self

    def __exit__(self, *_: object) -> None:
        self._table = np.zeros(0, RESULT)
        self._path.unlink(missing_ok=True)

    def rows(self, first: int, last: int) -> NDArray[Any]:
        """Return the rows `first` to `last` (exclusive)."""
        return np.asarray(self._table[first:last])

    def n_known(self) -> int:
        """Count the points that a finished tile holds."""
        return int(np.count_nonzero(self._table["known"]))

    def fill(self, fragments: Iterable[Path], source: int, *, without: Collection[int] = ()) -> None:
        """
        Enter the results of saved tiles, in the order given.

        A building's own tile has the last word on its points, which may be core points of another tile.

        Parameters
        ----------
        fragments : iterable of Path
            Saved tiles, sorted by stamp.
        source : int
            The input's number.
        without : collection of int
            Ids of buildings that are not to be entered.
        """
        left_out = np.array(sorted(without), dtype=np.uint32)
        paths = list(fragments)
        steps: tuple[tuple[str, Callable[[NDArray[Any]], None]], ...] = (
            ("core", self._enter_core),
            ("edges", self._enter_edges),
            ("roofs", self._enter_roofs),
        )
        for name, enter in steps:
            for path in paths:
                rows = load_rows(path, name, source)
                mine = rows[rows["index"] < len(self._table)]
                if name == "roofs" and len(left_out):
                    mine = mine[~np.isin(mine["building_id"], left_out)]
                if len(mine):
                    enter(mine)

    def _enter_core(self, rows: NDArray[Any]) -> None:
        self._table["known"][rows["index"]] = 1
        for name in ("classification", "height_above_ground", "facade"):
            self._table[name][rows["index"]] = rows[name]

    def _enter_edges(self, rows: NDArray[Any]) -> None:
        self._table["edge"][rows["index"]] = rows["edge"]

    def _enter_roofs(self, rows: NDArray[Any]) -> None:
        """Enter building and plane ids, and the edge labels that go with them."""
        for name in ("building_id", "plane_id", "edge"):
            self._table[name][rows["index"]] = rows[name]
