"""Polygons and lines with attributes written to GeoPackage and FlatGeobuf files."""

from __future__ import annotations

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

from lidar_buildings.io.files.atomic_files import atomic_file, writing

#: How each type of attribute is held in arrays.
_DTYPES: dict[type, Any] = {int: np.int64, str: object}
#: What stands in an array where a value is missing; a mask says so beside it.
_VOID: dict[type, Any] = {int: 0, str: None}
FAILURES = (DataLayerError, DataSourceError, FeatureError, FieldError, GeometryError, OSError, RuntimeError)
#: So that equal content gives equal bytes: the date that stands in the file's tables, and no thread for the
#: index, which needs other transactions, counted in the file, and is there only where there are two cores.
#: And no waiting for the disk at each of its transactions: the file has its name when all are written.
_FIXED = {
    "OGR_CURRENT_DATE": "2000-01-01T00:00:00.000Z",
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
def geopackage_file(path: Path, crs: str) -> Iterator[Callable[[VectorLayer], None]]:
    """
    Give a function that adds a layer to a file, or geometries to a layer that is there.

    The file appears when the block ends well; OutputError if it cannot be written.
    """
    counts: dict[str, int] = {}
    with atomic_file(path, has_rivals=True) as temporary:

        def add(layer: VectorLayer) -> None:
            with writing(path, FAILURES), _fixed_options():
                write_layer(temporary, layer, crs, append=bool(counts))
            counts[layer.name] = counts.get(layer.name, 0) + len(layer.geometries)

        yield add
        with writing(path, FAILURES):
            check_complete(temporary, counts)


def write_flatgeobuf(path: Path, layer: VectorLayer, crs: str) -> None:
    """
    Write a layer with a spatial index; the format has its features in the order of that, and takes no more.

    OutputError if the file cannot be written.
    """
    with atomic_file(path, FAILURES) as temporary:
        write_layer(temporary, layer, crs, driver="FlatGeobuf")
        check_complete(temporary, {layer.name: len(layer.geometries)})


def write_layer(
    path: Path, layer: VectorLayer, crs: str, *, append: bool = False, driver: str = "GPKG"
) -> None:
    """Write one layer with GDAL."""
    columns = columns_of(layer)
    with warnings.catch_warnings():
        # A cloud without reference system is legal, and said so in the run's record.
        warnings.filterwarnings("ignore", message="'crs' was not provided")
        pyogrio.raw.write(
            path,
            geometry=wkb_of(layer),
            field_data=[values for values, _ in columns],
            fields=list(layer.fields),
            field_mask=[is_missing for _, is_missing in columns],
            layer=layer.name,
            driver=driver,
            geometry_type=layer.kind,
            crs=crs or None,
            append=append,
            layer_options={"GEOMETRY_NAME": "geometry"} if driver == "GPKG" else None,
        )


def columns_of(layer: VectorLayer) -> list[tuple[NDArray[Any], NDArray[np.bool_]]]:
    """Return each field's values and which are missing."""
    return [_column([row.get(name) for row in layer.rows], kind) for name, kind in layer.fields.items()]


def wkb_of(layer: VectorLayer) -> NDArray[np.object_]:
    """Return a layer's geometries as WKB."""
    geometry = np.empty(len(layer.geometries), dtype=object)
    if len(layer.geometries):
        dimension = 3 if layer.kind.endswith("Z") else 2
        geometry[:] = shapely.to_wkb(list(layer.geometries), output_dimension=dimension)
    return geometry


def _column(values: list[Any], kind: type) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return a field's values and which are missing: None, and numbers that are not finite."""
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


@contextmanager
def _fixed_options() -> Iterator[None]:
    """Let GDAL write the same bytes for the same content."""
    with _one_writer:
        pyogrio.set_gdal_config_options(_FIXED)
        try:
            yield
        finally:
            pyogrio.set_gdal_config_options(dict.fromkeys(_FIXED))
