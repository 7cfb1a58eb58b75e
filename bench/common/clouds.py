"""Clouds to measure on: points, what is known of the scan, and the reference's ground."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.scans.scan import KEPT
from lidar_buildings.io.clouds.las import frame_of, open_inputs
from lidar_buildings.io.clouds.point_columns import point_columns, without_empty_columns, xyz_of

ROOT = Path(__file__).resolve().parents[2]
#: Where the real clouds lie unless --data or LIDAR_BUILDINGS_DATA says otherwise: beside the repository.
DEFAULT_DATA = ROOT / ".." / "shared" / "data"
#: Columns of a file that the ground filter and the selection of roofs look at.
COLUMNS = KEPT
#: What `classify_ground` can be told of the scan.
SCAN_COLUMNS = ("gps_time", "scan_angle", "scan_direction_flag", "point_source_id")


class Cloud(NamedTuple):
    """What a filter is given, and what it is judged by."""

    points: NDArray[np.float64]  #: in the map frame, rounded to float32 as in a run [m], shape (n_points, 3)
    scan: dict[str, NDArray[Any]]  #: those of `SCAN_COLUMNS` that the source has
    is_ground: NDArray[np.bool_]  #: the reference, shape (n_points,)


def data_folder(argument: str | None) -> Path:
    """Folder of the real clouds: the argument, else LIDAR_BUILDINGS_DATA, else beside the repository."""
    return Path(argument or os.environ.get("LIDAR_BUILDINGS_DATA") or DEFAULT_DATA).resolve()


def read_tile(folder: Path) -> tuple[PointTile, MapFrame]:
    """Read a folder's clouds as one tile, and where its map frame lies."""
    return read_files(sorted(folder.glob("*.laz")))


def read_files(paths: Sequence[Path]) -> tuple[PointTile, MapFrame]:
    """Read files as one tile, and where its map frame lies."""
    inputs, problems = open_inputs(list(paths))
    if problems:
        raise SystemExit("\n".join(problems))
    frame = frame_of(inputs)
    parts = [
        {"points": frame.to_map(xyz_of(chunk)), **point_columns(chunk)}
        for source in inputs
        for chunk in source.chunks()
    ]
    columns: dict[str, Any] = {
        name: np.concatenate([part[name] for part in parts]) for name in ("points", *COLUMNS)
    }
    return PointTile(points=columns.pop("points"), **without_empty_columns(columns)), frame


def read_cloud(paths: Sequence[Path], reference_ground: Collection[int] = (2,)) -> Cloud:
    """
    Read files as one cloud, in the order given; `reference_ground` are the classes that count as ground.
    """
    tile, _ = read_files(paths)
    points = tile.points.astype(np.float32).astype(np.float64)
    scan = {name: column for name in SCAN_COLUMNS if (column := getattr(tile, name)) is not None}
    return Cloud(points, scan, np.isin(tile.classification, list(reference_ground)))


def moved(cloud: Cloud, offset: Collection[float]) -> Cloud:
    """Return the cloud elsewhere in the map frame, so that grids cut it in other places."""
    return cloud._replace(points=cloud.points + np.array([*offset, 0.0]))
