"""PLY and PCD files, made LAZ as the scans of bags are, where the libraries that read them are installed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.bounds import MAX_COORDINATE
from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.scans.scan import KEPT, NOT_FINITE, PlacedScan
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.files.failures import one_line
from lidar_buildings.io.files.reference_systems import check_metres
from lidar_buildings.io.tiling.placed_laz import FAR, PlacedLaz

#: Points that are written at once.
_BATCH = 500_000


def write_points(source: Path, target: Path) -> tuple[int, dict[str, int]]:
    """
    Write the points of a file as LAZ; return how many, and why others are left out.

    Of PLY the coordinates alone are read. InputError if it cannot be read, is a mesh or has no points;
    OutputError if the other cannot be written.
    """
    try:
        points, columns = _of_ply(source) if source.suffix.lower() == ".ply" else _of_pcd(source)
    except InputError:
        raise
    except Exception as error:
        kind = source.suffix[1:].upper()
        raise InputError(f"{source}: cannot be read as {kind} ({one_line(error)}): write it again") from error
    with np.errstate(invalid="ignore"):
        is_place = (np.abs(points) <= MAX_COORDINATE).all(axis=1)
    if not is_place.any():
        raise InputError(f"{source}: contains no points: check what wrote it")
    points = points.compress(is_place, axis=0)
    columns = {name: np.nan_to_num(values.compress(is_place)) for name, values in columns.items()}
    columns.setdefault("gps_time", np.zeros(len(points)))
    with atomic_file(target) as temporary:
        file = PlacedLaz(temporary)
        for begin in range(0, len(points), _BATCH):
            own = slice(begin, begin + _BATCH)
            part = points[own]
            values = {name: one[own] for name, one in columns.items()}
            file.add(PlacedScan(part, np.zeros(len(part), np.int64), values))
        file.close()
        check_metres(source, file.n_points, file.size)
    left_out = {NOT_FINITE: int(np.count_nonzero(~is_place)), FAR: file.n_far}
    return file.n_points, {why: n for why, n in left_out.items() if n}


def _of_ply(path: Path) -> tuple[NDArray[np.float64], dict[str, NDArray[Any]]]:
    import trimesh

    read: Any = trimesh.load(path, process=False)
    if len(getattr(read, "faces", ())):
        raise InputError(
            f"{path}: is a mesh of {len(read.faces):,} faces: give the points that it was made of"
        )
    return np.asarray(read.vertices, dtype=np.float64).reshape(-1, 3), {}


def _of_pcd(path: Path) -> tuple[NDArray[np.float64], dict[str, NDArray[Any]]]:
    import pypcd4

    cloud: Any = pypcd4.PointCloud.from_path(path)
    rows: Mapping[str, NDArray[Any]] = {name: cloud.pc_data[name].reshape(-1) for name in cloud.fields}
    missing = [name for name in "xyz" if name not in rows]
    if missing:
        raise InputError(f"{path}: has no field {' or '.join(missing)} (its fields: {', '.join(rows)})")
    points = np.column_stack([rows[name].astype(np.float64) for name in "xyz"])
    return points, {name: rows[name] for name in KEPT if name in rows}
