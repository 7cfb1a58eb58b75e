"""The classified points round a building or a place."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import CLASS_NAMES, PointClass
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.clouds.las import open_cloud, xyz_of
from lidar_buildings.io.tiling.tile_grid import Rectangle
from lidar_buildings.report.shown_points import limits_of

_COLUMNS = {
    "classification": "classification",
    "height": "HeightAboveGround",
    "facade": "Facade",
    "building_id": "BuildingId",
    "plane_id": "PlaneId",
    "return_number": "return_number",
    "number_of_returns": "number_of_returns",
}


@dataclass(frozen=True, eq=False)
class Site:
    """Points within a box, noise left out."""

    points: NDArray[np.float64]  #: map frame [m], shape (n, 3)
    #: As the clouds say; 0 where they do not. Heights above ground [m]. Shape (n,).
    classification: NDArray[np.float64]
    height: NDArray[np.float64]
    facade: NDArray[np.float64]
    building_id: NDArray[np.float64]
    plane_id: NDArray[np.float64]
    return_number: NDArray[np.float64]
    number_of_returns: NDArray[np.float64]

    def select(self, chosen: NDArray[np.bool_]) -> Site:
        """Return some of the points."""
        return Site(*(values[chosen] for values in self.__dict__.values()))

    def roof_of(self, number: int) -> Site:
        """Return a building's points but for its façades."""
        return self.select((self.building_id == number) & (self.facade == 0) & (number > 0))

    def per_class(self) -> str:
        """Say how many points there are of each class."""
        codes, counts = np.unique(self.classification, return_counts=True)
        named = sorted(zip(counts.tolist(), codes.astype(int).tolist(), strict=True), reverse=True)
        return ", ".join(f"{n:,} {CLASS_NAMES.get(code, f'class {code}')}" for n, code in named) or "none"


def read_site(clouds: Iterable[Path], frame: MapFrame, box: Rectangle) -> Site:
    """
    Read the points of classified clouds within a box of the map frame.

    InputError if a cloud cannot be read.
    """
    parts = [np.empty((0, 3 + len(_COLUMNS)))]
    for path in clouds:
        cloud = open_cloud(path)
        if not box.touches(limits_of(cloud, frame)):
            continue
        known = set(cloud.header.point_format.dimension_names)
        for chunk in cloud.chunks():
            xyz = frame.to_map(xyz_of(chunk))
            inside = box.holds(xyz[:, 0], xyz[:, 1])
            inside &= ~np.isin(chunk["classification"], (PointClass.LOW_NOISE, PointClass.HIGH_NOISE))
            columns = [
                np.asarray(chunk[name], dtype=np.float64)[inside] if name in known else np.zeros(inside.sum())
                for name in _COLUMNS.values()
            ]
            parts.append(np.column_stack([xyz[inside], *columns]))
    table = np.concatenate(parts)
    height = table[:, 4] * frame.vertical_unit
    return Site(table[:, :3], table[:, 3], height, *table[:, 5:].T)
