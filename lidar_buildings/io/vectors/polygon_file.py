"""A layer of polygons of any file that GDAL reads, with its columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from pyogrio.errors import DataLayerError, DataSourceError, FeatureError, FieldError, GeometryError

from lidar_buildings.core.model.errors import InputError

_FAILURES = (DataLayerError, DataSourceError, FeatureError, FieldError, GeometryError, OSError, RuntimeError)
#: Kinds of layer that can hold polygons; a layer without a kind may hold any.
_POLYGON_KINDS = ("Polygon", "Surface", "Unknown", "GeometryCollection", "PolyhedralSurface", "TIN")
#: Layers of earlier results that hold no footprints where another one does.
_OUTLINES = "outlines"


@dataclass(frozen=True, eq=False)
class PolygonLayer:
    """
    What a layer holds.

    Attributes
    ----------
    path : Path
        The file.
    name : str
        Of the layer.
    geometries : ndarray
        shapely geometries of any type; None where a feature has none or one that cannot be understood.
    columns : mapping
        Name → values, one per feature.
    fids : ndarray of int
        The features' numbers in the file.
    crs : str
        As GDAL names it, empty if unknown.
    """

    path: Path
    name: str
    geometries: NDArray[Any]
    columns: Mapping[str, NDArray[Any]]
    fids: NDArray[np.int64]
    crs: str

    @property
    def label(self) -> str:
        """The file for messages, with the layer where it is not named like the file."""
        return str(self.path) if self.name == self.path.stem else f"{self.path} ({self.name})"


def read_layer(path: Path, layer: str = "") -> PolygonLayer:
    """
    Read a layer: the one that is named, or the only one that can hold polygons.

    Of several layers `outlines`, as in this program's own results, or the one named like the file is taken.

    Raises
    ------
    InputError
        If the file is no vector file, has no such layer, or it is not clear which one is meant.
    """
    try:
        found = [(str(name), str(kind or "")) for name, kind in pyogrio.list_layers(path)]
        name = _chosen(path, found, layer)
        meta, fids, wkb, columns = pyogrio.raw.read(path, layer=name, return_fids=True)
    except _FAILURES as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(
            f"{path}: cannot be read as a file of polygons ({reason}): give a GeoPackage, Shapefile, GeoJSON "
            "or the like"
        ) from error
    names = [str(one) for one in meta["fields"]]
    geometries = np.full(len(fids), None) if wkb is None else shapely.from_wkb(wkb, on_invalid="ignore")
    return PolygonLayer(
        path, name, geometries, dict(zip(names, columns, strict=True)), fids, str(meta["crs"] or "")
    )


def _chosen(path: Path, found: list[tuple[str, str]], layer: str) -> str:
    """Return the name of the layer to read."""
    names = [name for name, _ in found]
    if layer:
        if layer in names:
            return layer
        raise InputError(f"{path}: has no layer {layer!r}: there are {', '.join(names) or 'none'}")
    with_polygons = [name for name, kind in found if any(word in kind for word in _POLYGON_KINDS)]
    if not with_polygons:
        kinds = ", ".join(sorted({kind or "no geometry" for _, kind in found})) or "no layer"
        raise InputError(f"{path}: has no layer of polygons ({kinds}): give a file that has")
    preferred = [name for name in with_polygons if name in (_OUTLINES, path.stem)]
    if len(with_polygons) > 1 and len(preferred) != 1:
        raise InputError(
            f"{path}: has several layers of polygons ({', '.join(with_polygons)}): say which one with "
            "--footprints-layer"
        )
    return (preferred or with_polygons)[0]
