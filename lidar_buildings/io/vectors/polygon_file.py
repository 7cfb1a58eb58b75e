"""Polygons with their attributes from any file that GDAL reads (GeoPackage, Shapefile …), and GeoParquet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.vectors.geopackage import FAILURES
from lidar_buildings.io.vectors.geoparquet import ENDING, read_geoparquet

#: Kinds of layer that can hold polygons; a layer without a kind may hold any.
_POLYGON_KINDS = ("Polygon", "Surface", "Unknown", "GeometryCollection", "PolyhedralSurface", "TIN")
#: Layers of earlier results that hold no footprints where another one does.
_OUTLINES = "outlines"


@dataclass(frozen=True, eq=False)
class PolygonLayer:
    """What a layer holds."""

    path: Path
    name: str
    #: Shapely geometries of any type; None where a feature has none or one that cannot be understood.
    geometries: NDArray[Any]
    columns: Mapping[str, NDArray[Any]]  #: name → values, one per feature
    fids: NDArray[np.int64]  #: the features' numbers in the file
    crs: str  #: as GDAL names it, empty if unknown

    @property
    def label(self) -> str:
        """The file for messages, with the layer where it is not named like the file."""
        return str(self.path) if self.name == self.path.stem else f"{self.path} ({self.name})"


def read_layer(path: Path, layer: str = "") -> PolygonLayer:
    """
    Read a layer: the one that is named, or the only one that can hold polygons.

    Of several layers `outlines`, as in this program's own results, or the one named like the file is taken.
    InputError if the file is no vector file, has no such layer, or it is not clear which one is meant.
    """
    return _read(path, _chosen(path, layer))


def read_polygons(path: Path, layer: str = "") -> tuple[NDArray[np.object_], dict[str, NDArray[Any]], str]:
    """
    Read the polygons of a layer one by one: the one that is named, else `outlines`, else the first with any.

    The parts of a multi-polygon stand one by one, each with its attributes; features without polygon are left
    out. The reference system is as GDAL names it, empty if unknown. InputError if the file or the layer is
    not there or cannot be read.
    """
    if not layer:
        names = _with_polygons(path, _layers(path))
        layer = _OUTLINES if _OUTLINES in names else names[0]
    found = _read(path, _chosen(path, layer))
    kinds = shapely.get_type_id(found.geometries)
    rows = np.flatnonzero(np.isin(kinds, [shapely.GeometryType.POLYGON, shapely.GeometryType.MULTIPOLYGON]))
    parts, owner = shapely.get_parts(found.geometries[rows], return_index=True)
    kept = ~shapely.is_empty(parts)
    attributes = {name: column[rows[owner[kept]]] for name, column in found.columns.items()}
    return parts[kept], attributes, found.crs


def _layers(path: Path) -> dict[str, str]:
    """Return the name of each layer of a file with its kind of geometry, empty for none."""
    if path.suffix == ENDING and path.exists():
        return {path.stem: "Unknown"}
    with _reported(path):
        return {str(name): str(kind or "") for name, kind in pyogrio.list_layers(path)}


def _read(path: Path, name: str) -> PolygonLayer:
    if path.suffix == ENDING:  # for which GDAL's driver is in no wheel of pyogrio
        geometries, fields, crs = read_geoparquet(path)
        return PolygonLayer(path, name, geometries, fields, np.arange(len(geometries)), crs)
    with _reported(path):
        meta, fids, wkb, columns = pyogrio.raw.read(path, layer=name, return_fids=True)
    names = [str(one) for one in meta["fields"]]
    geometries = np.full(len(fids), None) if wkb is None else shapely.from_wkb(wkb, on_invalid="ignore")
    return PolygonLayer(
        path, name, geometries, dict(zip(names, columns, strict=True)), fids, str(meta["crs"] or "")
    )


def _with_polygons(path: Path, layers: Mapping[str, str]) -> list[str]:
    """Return the layers that can hold polygons, of which there must be one."""
    names = [name for name, kind in layers.items() if any(word in kind for word in _POLYGON_KINDS)]
    if not names:
        kinds = ", ".join(sorted({kind or "no geometry" for kind in layers.values()})) or "no layer"
        raise InputError(f"{path}: has no layer of polygons ({kinds}): give a file that has")
    return names


def _chosen(path: Path, layer: str) -> str:
    layers = _layers(path)
    if layer:
        if layer in layers:
            return layer
        raise InputError(f"{path}: has no layer {layer!r}: there are {', '.join(layers) or 'none'}")
    names = _with_polygons(path, layers)
    preferred = [name for name in names if name in (_OUTLINES, path.stem)]
    if len(names) > 1 and len(preferred) != 1:
        raise InputError(
            f"{path}: has several layers of polygons ({', '.join(names)}): say which one with "
            "--footprints-layer"
        )
    return (preferred or names)[0]


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    """Turn what fails within into one InputError."""
    if not path.exists():
        raise InputError(f"{path}: no such file: check the path")
    try:
        yield
    except FAILURES as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(
            f"{path}: cannot be read as a file of polygons ({reason}): give a GeoPackage, Shapefile, GeoJSON "
            "or the like"
        ) from error
