"""Footprints in the map frame with the ids of their buildings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.ids import CELL, building_id
from lidar_buildings.core.model.outline import Outline


@dataclass(frozen=True, eq=False)
class Footprints:
    """Outlines that are given, each of one building."""

    outlines: tuple[Outline, ...]  #: as a message carries them, map frame [m]
    building_id: NDArray[np.uint32]  #: unique, shape (n_footprints,)
    bounds: NDArray[np.float64]  #: west, south, east and north limit of each [m], shape (n_footprints, 4)
    area: NDArray[np.float64]  #: without courtyards [m²], shape (n_footprints,)

    def __len__(self) -> int:
        """Return the number of footprints."""
        return len(self.outlines)

    def touching(self, box: tuple[float, float, float, float]) -> NDArray[np.intp]:
        """
        Return the footprints whose bounds reach into a box, the largest first, equal ones by falling id.
        """
        west, south, east, north = box
        low, high = self.bounds[:, :2], self.bounds[:, 2:]
        rows = np.flatnonzero((low <= (east, north)).all(axis=1) & (high >= (west, south)).all(axis=1))
        return rows[np.lexsort((self.building_id[rows], self.area[rows]))[::-1]]

    def near(self, box: tuple[float, float, float, float]) -> Footprints:
        """Return the footprints whose bounds reach into a box alone."""
        rows = np.sort(self.touching(box))
        outlines = tuple(self.outlines[row] for row in rows)
        return Footprints(outlines, self.building_id[rows], self.bounds[rows], self.area[rows])


def footprints_of(polygons: Sequence[shapely.Polygon]) -> Footprints:
    """
    Number polygons: each building's id is that of the cell in which a point inside its footprint lies.

    Where two have their points in one cell, the one further east by its limits takes the next free cell to
    the east. So the ids depend on the footprints, not on their order nor on how points are cut into tiles.
    The polygons are as `repaired_polygons` gives them.
    """
    shapes = np.array(list(polygons), dtype=object)
    outlines = tuple(Outline.of(polygon).as_carried() for polygon in shapes)
    bounds = shapely.bounds(shapes).reshape(-1, 4)
    area = shapely.area(shapes).reshape(-1)
    anchors = shapely.get_coordinates(shapely.point_on_surface(shapes)).reshape(-1, 2)
    order = np.lexsort((area, *anchors.T[::-1], *bounds.T[::-1]))
    return Footprints(outlines, _unique_ids(anchors, order), bounds, area)


def last_polygon_around(
    xy: NDArray[np.float64], polygons: Sequence[shapely.Geometry | None]
) -> NDArray[np.int32]:
    """Return for each point the last of the polygons that it lies in, or on the edge of, −1 for none."""
    found = np.full(len(xy), -1, dtype=np.int32)
    order = np.argsort(xy[:, 0], kind="stable")
    x, y = np.ascontiguousarray(xy.take(order, axis=0).T)
    for number, polygon in enumerate(polygons):
        west, south, east, north = shapely.bounds(polygon)
        begin, end = np.searchsorted(x, west), np.searchsorted(x, east, side="right")
        near = begin + np.flatnonzero((y[begin:end] >= south) & (y[begin:end] <= north))
        shapely.prepare(polygon)
        found[order[near[shapely.intersects_xy(polygon, x[near], y[near])]]] = number
    return found


def _unique_ids(anchors: NDArray[np.float64], order: NDArray[np.intp]) -> NDArray[np.uint32]:
    """Give every anchor its cell's id, or that of the next cell to the east that is free."""
    numbers = np.zeros(len(anchors), dtype=np.uint32)
    taken: set[int] = set()
    for row in order:
        anchor = anchors[row].copy()
        while (number := building_id(anchor)) in taken:
            anchor[0] += CELL
        taken.add(number)
        numbers[row] = number
    return numbers
