"""Placed scans written as LAZ, as a source of points that everything after it reads like any other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyproj
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.scans.scan import PlacedScan
from lidar_buildings.io.clouds.cloud import laz_backend
from lidar_buildings.io.clouds.point_columns import SCAN_ANGLE_STEP, VIEW
from lidar_buildings.io.tiling.tile_stamps import gps_time_of

#: Resolution of the coordinates [m]: finer than any scanner measures.
SCALE = 0.001
#: The numbers that a dimension holds (LAS 1.4, point format 6).
_LIMITS = {
    "scan_angle": (-30_000, 30_000),
    "return_number": (0, 15),
    "number_of_returns": (0, 15),
    "classification": (0, 255),
    "scan_direction_flag": (0, 1),
    "view": (0, View.STREET),
}
#: Points gathered before they are encoded: a chunk of LAZ has 50,000.
_BATCH = 500_000
#: The file's origin is rounded to this [m].
_STEP = 100.0
#: How far from its origin a file reaches: LAS counts steps of `SCALE` in 32 bits [m].
_REACH = 2_000_000.0
#: Why points are left out, in words.
FAR = "further than 2,000 km from the first points"


class PlacedLaz:
    """A LAZ file that grows by scans: `n_points` were written, `n_far` were too far from the others."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._writer: laspy.LasWriter | None = None
        self._crs: pyproj.CRS | None = None
        self._frame = MapFrame()
        self._batch: list[PlacedScan] = []
        self._brightness = 1.0
        self.n_points = self.n_far = 0

    def place(self, frame: MapFrame) -> None:
        """Say where the map lies, as `map_origin` and `map_units` do."""
        self._crs = pyproj.CRS(frame.crs) if frame.crs else None
        self._frame = frame

    def add(self, scan: PlacedScan) -> None:
        """Add a scan's points."""
        self._batch.append(scan)
        if sum(len(one.points) for one in self._batch) >= _BATCH:
            self._flush()

    def close(self) -> None:
        """Write the rest; a file without any point is a valid one, too."""
        self._flush()
        if self._writer is not None:
            self._writer.close()

    @property
    def size(self) -> tuple[float, float, float]:
        """How far the points that were written reach along x, y and z, in units of the reference system."""
        if self._writer is None or not self.n_points:
            return 0.0, 0.0, 0.0
        x, y, z = (self._writer.header.maxs - self._writer.header.mins).tolist()
        return x, y, z

    def _flush(self) -> None:
        points = np.concatenate([np.empty((0, 3)), *(one.points for one in self._batch)])
        points = self._frame.to_source(points)
        if self._writer is None:
            self._writer = self._opened(points)
            # drivers count to 255 and more, or from 0 to 1
            seen = [
                one.columns["intensity"].max(initial=0) for one in self._batch if "intensity" in one.columns
            ]
            self._brightness = 1.0 / 255.0 if 0 < max(seen, default=0) <= 1 else 1.0
        near = (np.abs(points - self._writer.header.offsets) < _REACH).all(axis=1)
        n_near = int(np.count_nonzero(near))
        record = laspy.ScaleAwarePointRecord.zeros(n_near, header=self._writer.header)
        record.x, record.y, record.z = points[near].T
        columns = self._columns(len(points))
        views = columns.pop("view", None)
        for name, values in columns.items():
            record[name] = values[near]
        if views is not None and VIEW in self._writer.header.point_format.dimension_names:
            record[VIEW] = views[near]
        times = [one.columns.get("gps_time", gps_time_of(one.times)) for one in self._batch]
        record.gps_time = np.concatenate([np.empty(0), *times])[near]
        self._writer.write_points(record)
        self.n_points += n_near
        self.n_far += len(points) - n_near
        self._batch.clear()

    def _columns(self, n_points: int) -> dict[str, NDArray[Any]]:
        """Return the batch's columns as LAS has them; returns that are not known stay 0."""
        columns: dict[str, NDArray[Any]] = {"classification": np.ones(n_points, np.uint8)}
        steps = {"intensity": self._brightness, "scan_angle": SCAN_ANGLE_STEP}
        for name in {name for one in self._batch for name in one.columns} - {"gps_time"}:
            parts = [one.columns.get(name, np.zeros(len(one.points))) for one in self._batch]
            step = steps.get(name, 1.0)  # what one unit stands for
            values = np.rint(np.concatenate(parts).astype(np.float64) / step)
            low, high = _LIMITS.get(name, (0, 65_535))
            columns[name] = np.clip(values, low, high).astype(np.int32)
        return columns

    def _opened(self, points: NDArray[np.float64]) -> laspy.LasWriter:
        header = laspy.LasHeader(point_format=6, version="1.4")
        header.scales = np.full(3, SCALE)
        header.offsets = np.floor(points[0] / _STEP) * _STEP if len(points) else np.zeros(3)
        header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
        header.system_identifier = "placed scans"
        header.generating_software = "lidar_buildings"
        if any(one.columns["view"].any() for one in self._batch if "view" in one.columns):
            header.add_extra_dim(laspy.ExtraBytesParams(VIEW, "uint8", "1: from above, 2: from street"))
        if self._crs is not None:
            header.add_crs(self._crs)
        stream = open(self._path, "wb")  # noqa: SIM115
        return laspy.LasWriter(stream, header, do_compress=True, laz_backend=laz_backend(), closefd=True)
