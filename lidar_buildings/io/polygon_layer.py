"""
Polygons out of GIS files, in metres.

"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio.raw
import pyproj
import shapely
from numpy.typing import NDArray
from pyogrio.errors import DataLayerError, DataSourceError
from pyproj.exceptions import CRSError

from lidar_buildings.core.errors import InputError

#: The layer that counts where a file has several.
OUTLINES = "outlines"
#: What a folder is searched for: the output of a run, the truth of a simulated survey.
IN_FOLDER = ("buildings.gpkg", "truth.gpkg")


@dataclass(frozen=True, eq=False)
class PolygonLayer:
    """
    The polygons of a file.

    Attributes
    ----------
    polygons : ndarray of shapely geometries
        Polygons and multipolygons, one per feature, in plan [m].
    crs : str
        ``"EPSG:28992"``, a WKT text where no code is known, or empty.

    """

    polygons: NDArray[Any]
    crs: str


def read_polygon_layer(path: Path) -> PolygonLayer:
    """
    Read a GeoPackage or another vector file: its layer ``outlines``, else its first layer of polygons.

    Parameters
    ----------
    path : Path
        A file; or a folder with ``buildings.gpkg`` or ``truth.gpkg``.

    Raises
    ------
    InputError
        If there is no such file or no polygon in it.

    """
    file = _file_of(path)
    try:
        layer = _layer_of(file)
        meta, _, geometries, _ = pyogrio.raw.read(file, layer=layer, columns=[], force_2d=True)
    except (DataSourceError, DataLayerError, RuntimeError) as error:
        reason = " ".join(str(error).split()).split(";")[0].rstrip(".")
        raise InputError(f"{file}: cannot be read ({reason}): give a GeoPackage with polygons") from error
    polygons = shapely.from_wkb(geometries)
    polygons = polygons[(shapely.get_dimensions(polygons) == 2) & ~shapely.is_empty(polygons)]
    if not np.isfinite(shapely.bounds(polygons)).all():
        raise InputError(f"{file}: a coordinate in its layer {layer} is not a finite number: export it again")
    name, unit = _system(meta["crs"])
    return PolygonLayer(shapely.transform(polygons, lambda xy: xy * unit), name)


def _file_of(path: Path) -> Path:
    """
    Return the file that the path names, or that stands in the folder it names.

    """
    if path.is_dir():
        for name in IN_FOLDER:
            if (path / name).is_file():
                return path / name
        raise InputError(f"{path}: holds no {' or '.join(IN_FOLDER)}: name a file with polygons")
    if not path.is_file():
        raise InputError(f"{path}: no such file or folder: check the path")
    return path


def _layer_of(file: Path) -> str:
    """
    Return the name of the layer to read.

    """
    named = {str(name): str(kind) for name, kind in pyogrio.list_layers(file) if kind is not None}
    with_polygons = [name for name, kind in named.items() if "Polygon" in kind or kind == "Unknown"]
    if not with_polygons:
        raise InputError(f"{file}: has no layer of polygons: give one that does")
    return OUTLINES if OUTLINES in with_polygons else with_polygons[0]


def _system(text: str | None) -> tuple[str, float]:
    """
    Return the name of the horizontal reference system and the metres in its unit.

    """
    if not text:
        return "", 1.0
    try:
        crs = pyproj.CRS.from_user_input(text)
    except CRSError:
        return "", 1.0
    horizontal = crs.sub_crs_list[0] if crs.sub_crs_list else crs
    code = horizontal.to_epsg()
    unit = horizontal.axis_info[0].unit_conversion_factor if horizontal.is_projected else 1.0
    return f"EPSG:{code}" if code else horizontal.to_wkt(), float(unit)
