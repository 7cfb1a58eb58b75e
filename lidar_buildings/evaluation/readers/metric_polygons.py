"""The polygons of a result, a reference or an area of interest, in metres."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj.exceptions import CRSError

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.files.reference_systems import horizontal_part, name_of
from lidar_buildings.io.results.run_folder import BLOCKS
from lidar_buildings.io.vectors.layers import read_polygons

#: What a folder is searched for: the output of a run, the truth of a simulated survey; else blocks of a run.
IN_FOLDER = ("buildings.gpkg", "outlines.fgb", "truth.gpkg")
IN_BLOCKS = f"{BLOCKS}/*/outlines.fgb"


@dataclass(frozen=True, eq=False)
class MetricPolygons:
    """The polygons of a file, in plan."""

    polygons: NDArray[Any]  #: shapely.Polygon, in the file's reference system, but in metres
    #: The horizontal reference system: ``"EPSG:28992"``, a WKT text where no code is known, or empty.
    crs: str
    #: The layer's columns, one value per polygon, in the file's own units.
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    unit: float = 1.0  #: metres in the file's unit of length
    scale: float = 1.0  #: what x and y, in metres, are multiplied by to be true lengths


def read_metric_polygons(path: Path) -> MetricPolygons:
    """
    Read a vector file: its layer ``outlines``, else its first layer of polygons.

    Or a folder with ``buildings.gpkg``, ``outlines.fgb``, the latter in each of its blocks, or
    ``truth.gpkg``. InputError if there is no such file, no layer of polygons in it, or a coordinate is not
    finite.
    """
    files = files_of(path, IN_FOLDER, lambda: path.glob(IN_BLOCKS), "a file with polygons")
    parts, columns, systems = zip(*map(read_polygons, files), strict=True)
    attributes = {name: np.concatenate([one[name] for one in columns]) for name in columns[0]}
    flat = shapely.force_2d(np.concatenate(parts))
    if not np.isfinite(shapely.bounds(flat)).all():
        raise InputError(f"{path}: a coordinate of a polygon is not a finite number: export the file again")
    name, unit = _system(systems[0])
    return MetricPolygons(shapely.transform(flat, lambda xy: xy * unit), name, attributes, unit)


def files_of(
    path: Path, names: tuple[str, ...], others: Callable[[], Iterable[Path]], wanted: str
) -> list[Path]:
    """Return a file, or of a folder the first of some names, else the others; InputError if there is none."""
    if path.is_dir():
        named = [path / name for name in names if (path / name).is_file()]
        found = named[:1] or sorted(others())
        if not found:
            raise InputError(f"{path}: contains no {' or '.join(names)}: give {wanted}")
        return found
    if not path.is_file():
        raise InputError(f"{path}: no such file or folder: check the path")
    return [path]


def _system(text: str) -> tuple[str, float]:
    try:
        crs = horizontal_part(text)
    except CRSError:
        return "", 1.0
    return name_of(crs), float(crs.axis_info[0].unit_conversion_factor) if crs.is_projected else 1.0
