"""
Polygons and lines with attributes in GeoParquet 1.1 files (https://geoparquet.org), one layer each.

With pyarrow, the extra ``parquet``: GDAL's own driver is in no wheel of pyogrio or rasterio.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.vectors.geopackage import VectorLayer, columns_of, wkb_of

ENDING = ".parquet"
_GEOMETRY = "geometry"


@contextmanager
def geoparquet_file(path: Path, first: VectorLayer, crs: str) -> Iterator[Callable[[VectorLayer], None]]:
    """
    Give a function that adds a portion of a layer to a file.

    `first` tells the fields and the kind of geometries; its rows are not written. The file appears when the
    block ends well; OutputError if it cannot be written.
    """
    import pyarrow.parquet  # an extra

    schema = pyarrow.schema([*_fields(first, pyarrow), (_GEOMETRY, pyarrow.binary())])
    bounds: list[Any] = []
    # a schema of Arrow's own in the file would hide the metadata that are added at the end
    writer = partial(pyarrow.parquet.ParquetWriter, schema=schema, store_schema=False)
    with atomic_file(path) as temporary, writer(temporary) as file:

        def add(layer: VectorLayer) -> None:
            columns = [
                pyarrow.array(values, type=of.type, mask=is_missing)
                for of, (values, is_missing) in zip(schema, columns_of(layer), strict=False)
            ]
            columns.append(pyarrow.array(wkb_of(layer), type=pyarrow.binary()))
            file.write_table(pyarrow.table(columns, schema=schema))
            bounds.extend(shapely.bounds(list(layer.geometries)).tolist())

        yield add
        file.add_key_value_metadata({"geo": json.dumps(_metadata(first, crs, bounds))})


def _fields(layer: VectorLayer, pyarrow: Any) -> list[tuple[str, Any]]:
    types = {int: pyarrow.int64(), float: pyarrow.float64(), str: pyarrow.string()}
    return [(name, types[kind]) for name, kind in layer.fields.items()]


def _metadata(layer: VectorLayer, crs: str, bounds: list[Any]) -> dict[str, Any]:
    """Return what the specification wants to be said of the column of geometries."""
    column: dict[str, Any] = {
        "encoding": "WKB",
        "geometry_types": [layer.kind],
        # null: unknown; what is left out would be longitude and latitude
        "crs": pyproj.CRS.from_user_input(crs).to_json_dict() if crs else None,
    }
    if bounds:
        edges = np.array(bounds)
        column["bbox"] = [*edges[:, :2].min(axis=0).tolist(), *edges[:, 2:].max(axis=0).tolist()]
    return {"version": "1.1.0", "primary_column": _GEOMETRY, "columns": {_GEOMETRY: column}}


def read_geoparquet(path: Path) -> tuple[NDArray[Any], dict[str, NDArray[Any]], str]:
    """
    Read a file's geometries, columns and reference system (WKT, empty if unknown).

    InputError if pyarrow is not installed, or it is no GeoParquet file with geometries as WKB.
    """
    try:
        import pyarrow.parquet  # an extra
    except ImportError as error:
        raise InputError(f"{path}: GeoParquet needs pyarrow: install lidar_buildings[parquet]") from error
    try:
        table = pyarrow.parquet.read_table(path)
        told = json.loads((table.schema.metadata or {})[b"geo"])
        name = told["primary_column"]
        own = told["columns"][name]
        geometries = shapely.from_wkb(table[name].to_numpy(), on_invalid="ignore")
        columns = {one: table[one].to_numpy() for one in table.column_names if one != name}
        # what the specification takes a column for that names no system
        crs = pyproj.CRS.from_json_dict(own["crs"]) if own.get("crs") else None
        system = "" if crs is None and "crs" in own else (crs or pyproj.CRS("OGC:CRS84")).to_wkt()
    except (OSError, ValueError, KeyError, pyarrow.ArrowException, shapely.errors.ShapelyError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: cannot be read as GeoParquet ({reason}): export it again") from error
    return geometries, columns, system
