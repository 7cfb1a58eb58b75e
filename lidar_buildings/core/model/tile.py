"""A tile of points: named columns that all stages share and messages carry."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.bounds import checked_dark_limit, checked_spacing
from lidar_buildings.core.model.classes import FacadeClass, PointClass, View
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.stage_table import STAGE_TABLE

#: What the source knows of its points, and what is measured when a tile is made: name → dtype.
_SOURCE_COLUMNS = {
    "intensity": "<f4",
    "return_number": "u1",
    "number_of_returns": "u1",
    "classification": "u1",
    "scan_angle": "<f4",
    "scan_direction_flag": "u1",
    "point_source_id": "<u2",
    "gps_time": "<f8",
    "view": "u1",
    "buffer": "u1",
    "source": "<u2",
    "index": "<u4",
    "normalised_intensity": "<f4",
}
#: Column name → dtype, in the order in which messages carry them after x, y, z.
COLUMNS: dict[str, np.dtype[Any]] = {
    name: np.dtype(kind)
    for name, kind in (
        *_SOURCE_COLUMNS.items(),
        *(column for stage in STAGE_TABLE for column in stage.columns),
    )
}


#: Points that are compared at once.
_BLOCK = 8_192


def _is_carried(points: NDArray[Any]) -> bool:
    """Tell whether points are float64 and rounded to float32 already."""
    blocks = (points[begin : begin + _BLOCK] for begin in range(0, len(points), _BLOCK))
    return points.dtype == np.float64 and all((one == one.astype(np.float32)).all() for one in blocks)


@dataclass(frozen=True, eq=False)
class PointTile:
    """
    The points of one tile, holding exactly what a message can carry.

    Coordinates are rounded to float32 and columns cast to their message's dtype when the tile is made, so
    that a stage sees the same numbers with and without ROS. Rows are in the order of (`source`, `index`).

    - `points`, shape (n_points, 3), float64: Map frame [m]; those given, if they are rounded already.
    - `intensity`, `return_number`, `number_of_returns`, `classification`, ndarray: As in the source; None
      where it has none.
    - `scan_angle`, `scan_direction_flag`, `point_source_id`, `gps_time`, ndarray: Likewise; `scan_angle` in
      degrees.
    - `view`, uint8: `lidar_buildings.core.model.classes.View`; None where all was seen from above.
    - `buffer`, uint8: 1 = belongs to a neighbouring tile, given as context only.
    - `source`, `index`, ndarray: The point is row `index` of input number `source`.
    - `normalised_intensity`, ndarray: 0 to 255, the same in all flight strips of a survey; see
      `lidar_buildings.core.surfaces.intensity`.
    - height_above_ground ... plane_id, ndarray: What the stages appended.
    - `stamp`: The tile's key [ns].
    - `point_spacing`: Spacing of the pulses [m], the yardstick of other lengths; mostly one for a survey.
      None: not known.
    - `dark_limit`: Normalised intensity up to which ground is dark: one for a survey whose ground has two
      modes.
    - `bounds`, tuple of four float: West, south, east and north limit of the tile with its buffer [m]; None
      where nothing lies beyond it. A building that reaches these limits is not whole.
    - `frame`: Where the map frame lies.

    ValueError if a column's length differs from the number of points, `points` is not (n, 3), or a spacing or
    limit is none that can be.
    """

    points: NDArray[np.float64]
    intensity: NDArray[np.float32] | None = None
    return_number: NDArray[np.uint8] | None = None
    number_of_returns: NDArray[np.uint8] | None = None
    classification: NDArray[np.uint8] | None = None
    scan_angle: NDArray[np.float32] | None = None
    scan_direction_flag: NDArray[np.uint8] | None = None
    point_source_id: NDArray[np.uint16] | None = None
    gps_time: NDArray[np.float64] | None = None
    view: NDArray[np.uint8] | None = None
    buffer: NDArray[np.uint8] | None = None
    source: NDArray[np.uint16] | None = None
    index: NDArray[np.uint32] | None = None
    normalised_intensity: NDArray[np.float32] | None = None
    height_above_ground: NDArray[np.float32] | None = None
    facade: NDArray[np.uint8] | None = None
    linearity: NDArray[np.float32] | None = None
    planarity: NDArray[np.float32] | None = None
    normal_x: NDArray[np.float32] | None = None
    normal_y: NDArray[np.float32] | None = None
    normal_z: NDArray[np.float32] | None = None
    neighbourhood_radius: NDArray[np.float32] | None = None
    edge: NDArray[np.uint8] | None = None
    building_id: NDArray[np.uint32] | None = None
    plane_id: NDArray[np.uint16] | None = None
    stamp: int = 0
    point_spacing: float | None = None
    dark_limit: float | None = None
    bounds: tuple[float, float, float, float] | None = None
    frame: MapFrame = field(default_factory=MapFrame)

    def __post_init__(self) -> None:
        """Cast everything to what a message carries and check the lengths."""
        points = np.asarray(self.points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points has shape {points.shape}: must be (n_points, 3)")
        if not _is_carried(points):
            points = points.astype(np.float32, copy=False).astype(np.float64)
        object.__setattr__(self, "points", points)
        self._cast()

    def _cast(self) -> None:
        """Cast all but the points to what a message carries and check the lengths."""
        for name, checked in (("point_spacing", checked_spacing), ("dark_limit", checked_dark_limit)):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, float(np.float32(checked(value))))
        if self.bounds is not None:
            object.__setattr__(self, "bounds", tuple(float(np.float32(limit)) for limit in self.bounds))
        for name, dtype in COLUMNS.items():
            column = getattr(self, name)
            if column is None:
                continue
            column = np.ascontiguousarray(column, dtype=dtype)
            if column.shape != (len(self),):
                raise ValueError(f"{name} has shape {column.shape}: must be ({len(self)},)")
            object.__setattr__(self, name, column)

    def __len__(self) -> int:
        return len(self.points)

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """The columns that the tile has, in message order."""
        return {name: getattr(self, name) for name in COLUMNS if getattr(self, name) is not None}

    @property
    def world(self) -> NDArray[np.float64]:
        """The points in the source's reference system and units, shape (n_points, 3)."""
        return self.frame.to_source(self.points)

    @property
    def is_core(self) -> NDArray[np.bool_]:
        """True for the tile's own points, False for the buffer's."""
        return np.ones(len(self), dtype=bool) if self.buffer is None else self.buffer == 0

    @property
    def is_from_street(self) -> NDArray[np.bool_]:
        """True for points that were seen from the street."""
        return np.zeros(len(self), dtype=bool) if self.view is None else self.view >= View.STREET

    @property
    def is_covered(self) -> NDArray[np.bool_]:
        """True for points from the street at places that were seen from above: they tell no roofs."""
        return np.zeros(len(self), dtype=bool) if self.view is None else self.view == View.COVERED

    @property
    def is_roof(self) -> NDArray[np.bool_]:
        """True for points of class 6 that are no façade, and for all where nothing is classified."""
        if self.classification is None:
            return np.ones(len(self), dtype=bool)
        is_building = self.classification == PointClass.BUILDING
        return is_building if self.facade is None else is_building & (self.facade == 0)

    @property
    def has_bare_walls(self) -> bool:
        """Whether there are points of walls over which no roof was seen."""
        return self.facade is not None and bool((self.facade == FacadeClass.BARE).any())

    def with_columns(self, **columns: Any) -> PointTile:
        """Return the tile with these columns set or replaced."""
        if not columns.keys() <= COLUMNS.keys():
            return replace(self, **columns)
        tile = copy(self)  # the points are shared: they need no more casting, and are the most of the memory
        for name, column in columns.items():
            object.__setattr__(tile, name, column)
        tile._cast()
        return tile

    def select(self, rows: NDArray[Any]) -> PointTile:
        """Return the tile's rows chosen by a mask or by indices."""
        tile = copy(self)  # what it has needs no more casting
        rows = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
        for name in ("points", *self.columns):
            object.__setattr__(tile, name, getattr(self, name).take(rows, axis=0))
        return tile

    def joined(self, other: PointTile) -> PointTile:
        """Return the tile with another one's points after its own; ValueError if that lacks a column."""
        missing = sorted(self.columns.keys() - other.columns.keys())
        if missing:
            raise ValueError(f"other lacks {', '.join(missing)}: must have the columns of the tile")
        both: dict[str, Any] = {
            name: np.concatenate([column, getattr(other, name)]) for name, column in self.columns.items()
        }
        return replace(self, points=np.concatenate([self.points, other.points]), **both)
