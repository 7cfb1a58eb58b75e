"""What a LAS file's header alone says: how many points, where, in which system. No point is read."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds.agreement import MAX_EXTENT
from lidar_buildings.io.clouds.cloud import CloudExtent
from lidar_buildings.io.clouds.las_crs import metric_crs, source_crs
from lidar_buildings.io.clouds.las_records import read_raw_header
from lidar_buildings.io.files.failures import reported
from lidar_buildings.io.files.locations import state_of

#: Where the header has greatest and least x, y and z, in turns (LAS 1.4, table 3).
_BOUNDS, _BOUNDS_AT = struct.Struct("<6d"), 179


def read_extent(path: Path) -> CloudExtent:
    """Read a file's header; InputError if it is no LAS file, or its header cannot be true."""
    with reported(path):
        raw = read_raw_header(path)
        prefers_wkt = raw.minor_version >= 4 and bool(raw.global_encoding & 0x10)
        crs = source_crs(raw.vlrs + raw.evlrs, prefer_wkt=prefers_wkt, label=str(path))
        bounds = np.array(_BOUNDS.unpack_from(raw.block, _BOUNDS_AT)).reshape(3, 2)
        maxs, mins = bounds.T if raw.point_count else np.full((2, 3), np.nan)
        if raw.point_count:
            crs = metric_crs(path, crs, raw.point_count, mins, maxs)
        width = (maxs - mins)[:2] * crs.horizontal_unit
        if raw.point_count and not ((width >= 0.0) & (width <= MAX_EXTENT)).all():
            raise InputError(
                f"{path}: the bounds in its header cannot be: export it again (a run measures them anew)"
            )
        return CloudExtent(path, raw, crs, mins, maxs, state_of(path))
