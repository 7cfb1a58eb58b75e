"""Layers of polygons or lines with attributes, written and read by GDAL: GeoPackage, FlatGeobuf, others."""

from __future__ import annotations

import sqlite3
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from pyogrio.errors import DataLayerError, DataSourceError, FeatureError, FieldError, GeometryError

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.files.atomic_files import atomic_file, writing
from lidar_buildings.io.vectors.geopackage_looks import DATE, Looks, add_looks

#: How each type of attribute is held in arrays.
_DTYPES: dict[type, Any] = {int: np.int64, str: object}
#: What stands in an array where a value is missing; a mask says so beside it.
_VOID: dict[type, Any] = {int: 0, str: None}
FAILURES = (
    *(DataLayerError, DataSourceError, FeatureError, FieldError, GeometryError),
    *(OSError, RuntimeError, sqlite3.Error),
)
#: So that equal content gives equal bytes: the date that stands in the file's tables, and no thread for the
#: index, which needs other transactions, counted in the file, and is there only where there are two cores.
#: And no waiting for the disk at each of its transactions: the file has its name when all are written.
_FIXED = {
    "OGR_CURRENT_DATE": DATE,
    "OGR_GPKG_ALLOW_THREADED_RTREE": "NO",
    "OGR_SQLITE_SYNCHRONOUS": "OFF",
    "OGR_SQLITE_JOURNAL": "MEMORY",
}
#: GDAL's options belong to the whole process: one writer at a time.
_one_writer = threading.Lock()


@dataclass(frozen=True, eq=False)
class VectorLayer:
    """One layer of polygons or lines."""

    name: str
    geometries: Sequence[Any]  #: polygons with holes, or lines; none is legal
    fields: dict[str, type]  #: attribute → int, float or str, in the order of the columns
    #: One per geometry; what a row lacks, None and numbers that are not finite become null.
    rows: Sequence[dict[str, Any]]
    kind: str = "Polygon"  #: or ``Polygon Z``, ``LineString Z``, whose vertices carry z


@contextmanager
def geopackage_file(
    path: Path, crs: str, looks: Looks | None = None
) -> Iterator[Callable[[VectorLayer], None]]:
    """Give a function that adds a layer, or rows to one, to a file that appears when the block ends well."""
    counts: dict[str, int] = {}
    columns: dict[str, Sequence[str]] = {}
    with atomic_file(path, has_rivals=True) as temporary:

        def add(layer: VectorLayer) -> None:
            with writing(path, FAILURES), _one_writer:
                pyogrio.set_gdal_config_options(_FIXED)
                try:
                    write_layer(temporary, layer, crs, append=bool(counts))
                finally:
                    pyogrio.set_gdal_config_options(dict.fromkeys(_FIXED))
            counts[layer.name] = counts.get(layer.name, 0) + len(layer.geometries)
            columns[layer.name] = list(layer.fields)

        yield add
        with writing(path, FAILURES):
            if looks is not None:
                add_looks(temporary, looks, columns)
            check_complete(temporary, counts)


def write_flatgeobuf(path: Path, layer: VectorLayer, crs: str) -> None:
    """Write a layer with a spatial index at once; OutputError if the file cannot be written."""
    with atomic_file(path, FAILURES) as temporary:
        write_layer(temporary, layer, crs, driver="FlatGeobuf")
        check_complete(temporary, {layer.name: len(layer.geometries)})


def write_layer(
    path: Path, layer: VectorLayer, crs: str, *, append: bool = False, driver: str = "GPKG"
) -> None:
    """Write one layer with GDAL."""
    columns = [_column([row.get(name) for row in layer.rows], kind) for name, kind in layer.fields.items()]
    geometry = np.empty(len(layer.geometries), dtype=object)
    if len(layer.geometries):
        dimension = 3 if layer.kind.endswith("Z") else 2
        geometry[:] = shapely.to_wkb(list(layer.geometries), output_dimension=dimension)
    with warnings.catch_warnings():
        # A cloud without reference system is legal, and said so in the run's record.
        warnings.filterwarnings("ignore", message="'crs' was not provided")
        pyogrio.raw.write(
            path,
            geometry=geometry,
            field_data=[values for values, _ in columns],
            fields=list(layer.fields),
            field_mask=[is_missing for _, is_missing in columns],
            layer=layer.name,
            driver=driver,
            geometry_type=layer.kind,
            crs=crs or None,
            append=append,
            # GDAL before 3.7, Debian's for one, warns of later versions
            dataset_options={"VERSION": "1.3"} if driver == "GPKG" and not append else None,
            layer_options={"GEOMETRY_NAME": "geometry"} if driver == "GPKG" else None,
        )


def _column(values: list[Any], kind: type) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    if kind is float:
        numbers = np.array(values, dtype=np.float64)  # None becomes NaN
        return numbers, ~np.isfinite(numbers)
    is_missing = np.array([value is None or value != value for value in values], dtype=bool)
    known = [_VOID[kind] if gone else kind(value) for value, gone in zip(values, is_missing, strict=True)]
    return np.array(known, dtype=_DTYPES[kind]), is_missing


def check_complete(path: Path, counts: Mapping[str, int]) -> None:
    """Read back how many geometries each layer has: a full disk may show no sooner."""
    for name, count in counts.items():
        found = pyogrio.read_info(path, layer=name, force_feature_count=True)["features"]
        if found != count:
            raise OSError(f"layer {name} holds {found} of {count} geometries")


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
    with _reported(path):
        return {str(name): str(kind or "") for name, kind in pyogrio.list_layers(path)}


def _read(path: Path, name: str) -> PolygonLayer:
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
        raise InputError(f"{path}: has no layer of polygons ({kinds}): give a file that has one")
    return names


def _chosen(path: Path, layer: str) -> str:
    layers = _layers(path)
    if layer:
        if layer in layers:
            return layer
        raise InputError(f"{path}: has no layer {layer!r}: its layers are {', '.join(layers) or 'none'}")
    names = _with_polygons(path, layers)
    preferred = [name for name in names if name in (_OUTLINES, path.stem)]
    if len(names) > 1 and len(preferred) != 1:
        raise InputError(
            f"{path}: has several layers of polygons ({', '.join(names)}): choose one with --footprints-layer"
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
