"""From where the strips of a survey were seen."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.neighbours.strip_views import (
    CELL,
    count_cells,
    joined_counts,
    strip_numbers,
    strip_views,
    views_of_counts,
)
from lidar_buildings.io.tiling.tile_grid import Rectangle

Records: TypeAlias = "NDArray[Any] | dict[str, NDArray[Any]]"
#: Cells of a file that are counted at most, about.
MAX_CELLS = 20_000


class SurveyViews:
    """
    Learns, file by file, from where each strip of it was seen.

    What points tell themselves, by the poses of their scanner, counts before that, and a view that is `given`
    before all.
    """

    def __init__(self, given: View = View.UNKNOWN) -> None:
        self.given = given
        self._of_strips: dict[int, dict[int, View]] = {}
        self._of_files: dict[int, View] = {}
        self._counts: dict[int, list[NDArray[Any]]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the counts of files that have not been read to their end."""
        return self.__dict__ | {"_counts": {}}

    def add(self, source: int, records: NDArray[Any], area: Rectangle | None) -> None:
        """Count a chunk of a file, `io.tiling.spool.RECORD`, that covers an area in plan [m]."""
        points = np.stack([records[name] for name in "xyz"], axis=1).astype(np.float64)
        self.count(source, points, records, area)

    def count(
        self, source: int, points: NDArray[np.float64], columns: Records, area: Rectangle | None
    ) -> None:
        """Count points of a file, shape (n, 3) [m], by their columns."""
        if self.given is not View.UNKNOWN or area is None:
            return
        extent = (area.x_max - area.x_min) * (area.y_max - area.y_min)
        strip = strip_numbers(columns["point_source_id"], columns["gps_time"], len(points))
        if columns["view"].any():  # what is told stands for a strip below all others
            strip = np.where(columns["view"] == View.UNKNOWN, strip, -columns["view"].astype(np.int64))
        step = max(1, math.ceil(extent / CELL**2 / MAX_CELLS))
        self._counts.setdefault(source, []).append(count_cells(points, strip, step))

    def counted(self, source: int) -> NDArray[Any]:
        """Return what was counted of a file, for another process."""
        return joined_counts(self._counts.pop(source, []))

    def take(self, source: int, counts: NDArray[Any]) -> None:
        """Take what another process has counted of a file."""
        self._counts.setdefault(source, []).append(counts)

    def learn(self, source: int) -> dict[int, View]:
        """Tell the strips of a file that was read to its end; return strip, below 0 if it told, → view."""
        counts = joined_counts(self._counts.pop(source, []))
        views = views_of_counts(counts[counts["strip"] >= 0])
        from_street = [number for number, view in views.items() if view is View.STREET]
        is_street = np.isin(counts["strip"], [*from_street, -View.STREET])
        n_street = int(counts["count"][is_street].sum())
        self._of_files[source] = View.STREET if 2 * n_street > int(counts["count"].sum()) else View.ABOVE
        if View.STREET in views.values():
            self._of_strips[source] = views
        told = (-int(number) for number in np.unique(counts["strip"]) if number < 0)
        return views | {-number: View(number) for number in told}

    def forget(self, source: int) -> None:
        """Drop what was counted of a file that turned out unreadable."""
        self._counts.pop(source, None)

    @property
    def of_files(self) -> set[View]:
        """From where most of any file was seen."""
        return {self.of_file(source) for source in self._of_files}

    def of_file(self, source: int) -> View:
        """Return from where most of a file was seen, which has been learnt."""
        return self.given or self._of_files.get(source, View.ABOVE)

    def of(self, records: Records, points: NDArray[np.float64] | None = None) -> NDArray[np.uint8] | None:
        """
        Return the `View` of records, or of their columns; None if all were seen from above.

        The `points` of a feed whose poses are not told, shape (n, 3) [m], tell their strips themselves.
        """
        told = records["view"]
        if self.given is not View.UNKNOWN:
            is_street = self.given is View.STREET and len(told) > 0
            return np.full(len(told), View.STREET, dtype=np.uint8) if is_street else None
        found = np.array(told)
        if points is not None and not self._of_files and not told.any():
            strip = strip_numbers(records["point_source_id"], records["gps_time"], len(points))
            found = strip_views(points, strip)
        for source, views in self._of_strips.items():
            rows = np.flatnonzero((records["source"] == source) & (told == View.UNKNOWN))
            strip = strip_numbers(records["point_source_id"][rows], records["gps_time"][rows], len(rows))
            numbers, place = np.unique(strip, return_inverse=True)
            of_number = [views.get(int(one), self._of_files[source]) for one in numbers]
            found[rows] = np.array(of_number, dtype=np.uint8)[place.reshape(-1)]
        if not (found >= View.STREET).any():
            return None
        found[found == View.UNKNOWN] = View.ABOVE
        return found
