"""Footprints from any file of polygons, in the map frame."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.stages.footprints.footprints import Footprints, footprints_of, repaired_polygons
from lidar_buildings.io.files.failures import warn_once
from lidar_buildings.io.files.reference_systems import is_in_degrees, reprojected
from lidar_buildings.io.vectors.layers import PolygonLayer, read_layer

#: Columns that name an object, the most telling first; in any case.
_ID_COLUMNS = (
    "footprint_id", "building_id", "identificatie", "identifier", "gml_id", "gmlid", "lokaalid",
    "lokaal_id", "inspireid", "toid", "cleabs", "uuid", "guid", "globalid", "objectid", "object_id",
    "osm_id", "osm_way_id", "@id", "full_id", "id", "ogc_fid",
)  # fmt: skip
#: Runs of one process that may be under way at a time, each with its footprints.
_MOST_FILES = 4
_one_reader = threading.Lock()


@dataclass(frozen=True)
class FootprintSource:
    """Where footprints come from."""

    path: Path
    layer: str = ""  #: its layer, empty for the only one of polygons
    id_column: str = ""  #: the column that names a footprint, empty for one that looks like it


@dataclass(frozen=True, eq=False)
class FootprintFile:
    """The footprints of a file."""

    source: FootprintSource
    footprints: Footprints  #: in the map frame
    footprint_id: Mapping[int, str]  #: building id → what the file calls the footprint
    #: What ``run.json`` tells of the file: layer, column of the ids, and how many polygons were read,
    #: repaired, and left out for which reason.
    record: dict[str, Any]


def read_footprints(source: FootprintSource, frame: MapFrame) -> FootprintFile:
    """
    Read footprints into the map frame: transformed, repaired, and numbered.

    A file that several nodes of a process ask for is read once. Where clouds or the file name no reference
    system, both are taken to be in the same one. InputError if the file holds no polygons, or it is not clear
    which layer or column is meant.
    """
    if not source.path.exists():
        raise InputError(f"{source.path}: no such file: check the path of the footprints")
    with _one_reader:
        return _read(source, frame, source.path.stat().st_mtime_ns)


@lru_cache(maxsize=_MOST_FILES)
def _read(source: FootprintSource, frame: MapFrame, _: int) -> FootprintFile:
    """Read footprints; the time of the file's last change is there to read a changed file anew."""
    layer = read_layer(source.path, source.layer)
    column = _id_column(layer, source)
    repairs = repaired_polygons(_in_map(layer, frame))
    if not len(repairs.polygons):
        reasons = ", ".join(f"{n} {reason}" for reason, n in repairs.dropped.items()) or "no feature"
        raise InputError(
            f"{layer.label}: contains no polygon to use as a footprint ({reasons}): give a file of polygons"
        )
    footprints = footprints_of(repairs.polygons)
    names = _names(layer, column, repairs.row)
    record = {
        "file": str(source.path),
        "layer": layer.name,
        "id_column": column,
        "n_read": len(layer.geometries),
        "n_used": len(footprints),
        "n_repaired": repairs.n_repaired,
        "n_simplified": repairs.n_simplified,
        "left_out": dict(repairs.dropped),
    }
    ids = dict(zip(footprints.building_id.tolist(), names, strict=True))
    return FootprintFile(source, footprints, ids, record)


def check_overlap(file: FootprintFile, bounds: tuple[float, float, float, float], frame: MapFrame) -> None:
    """Refuse (InputError) footprints of which none reaches into the clouds' bounds, in their coordinates."""
    own = file.footprints.bounds
    of_all = np.concatenate([own[:, :2].min(axis=0), own[:, 2:].max(axis=0)])
    corners = np.array([[*bounds[:2], 0.0], [*bounds[2:], 0.0]])
    west, south, east, north = frame.to_map(corners)[:, :2].ravel()
    if len(file.footprints.touching((west, south, east, north))):
        return
    theirs = frame.to_source(np.insert(of_all.reshape(2, 2), 2, 0.0, axis=1))[:, :2].ravel()
    system = f" in {frame.crs[:20]}" if frame.crs else ""
    raise InputError(
        f"{file.source.path}: no footprint lies within the clouds: the footprints span {_extent(theirs)}, "
        f"the clouds {_extent(np.array(bounds))}{system}: check both coordinate reference systems"
    )


def _extent(bounds: NDArray[np.float64]) -> str:
    west, south, east, north = bounds
    return f"x {west:.0f} to {east:.0f} and y {south:.0f} to {north:.0f}"


def _in_map(layer: PolygonLayer, frame: MapFrame) -> NDArray[Any]:
    flat = shapely.force_2d(layer.geometries)
    if not frame.crs and is_in_degrees(layer.crs):
        raise InputError(
            f"{layer.label}: is in degrees ({layer.crs[:20]}) and the clouds name no coordinate reference "
            "system: transform the footprints to the clouds' system, or give clouds that name theirs"
        )
    if not layer.crs or not frame.crs:
        what = "the footprints" if not layer.crs else "the clouds"
        warn_once(
            f"{layer.label}: {what} name no coordinate reference system: footprints and clouds are assumed "
            "to be in the same one"
        )
    else:
        flat = reprojected(flat, layer.crs, frame.crs, layer.label)
    origin = np.array(frame.origin[:2])
    return shapely.transform(flat, lambda xy: xy * frame.horizontal_unit - origin)


def _id_column(layer: PolygonLayer, source: FootprintSource) -> str:
    if source.id_column:
        if source.id_column in layer.columns:
            return source.id_column
        raise InputError(
            f"{layer.label}: has no column {source.id_column!r}: its columns are "
            f"{', '.join(layer.columns) or 'none'}"
        )
    by_name = {name.lower(): name for name in reversed(list(layer.columns))}
    return next((by_name[name] for name in _ID_COLUMNS if name in by_name), "")


def _names(layer: PolygonLayer, column: str, rows: NDArray[np.intp]) -> list[str]:
    """Return what the file calls each footprint; parts of one feature are numbered."""
    own = layer.columns[column] if column else layer.fids
    names = [_text(own[row]) for row in rows]
    n_parts = np.bincount(rows, minlength=len(layer.geometries))
    counted: dict[int, int] = {}
    for place, row in enumerate(rows.tolist()):
        if n_parts[row] > 1:
            counted[row] = counted.get(row, 0) + 1
            names[place] = f"{names[place]}-{counted[row]}"
    return names


def _text(value: Any) -> str:
    """Write an identifier; whole numbers have no decimals, even where missing values made them fractions."""
    if value is None or value != value:
        return ""
    is_whole = isinstance(value, float | np.floating) and float(value).is_integer()
    return str(int(value) if is_whole else value)
