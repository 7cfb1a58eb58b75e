"""FlatGeobuf and GeoParquet: what GDAL and pyarrow read back, missing values, empty layers."""

import json

import numpy as np
import pyarrow.parquet as parquet
import pyogrio
import pyproj
import shapely

from lidar_buildings.io.vectors.layers import VectorLayer, geoparquet_file, write_flatgeobuf

FIELDS = {"number": int, "name": str, "height": float}


def layer(n=5, **options):
    shapes = [shapely.box(10.0 * i, 0.0, 10.0 * i + 5.0, 3.0) for i in range(n)]
    rows = [
        {"number": i, "name": "é" if i else None, "height": 1.5 * i if i != 2 else None} for i in range(n)
    ]
    return VectorLayer("outlines", shapes, FIELDS, rows, **options)


def written_parquet(path, *portions, crs="EPSG:28992"):
    with geoparquet_file(path, portions[0], crs) as add:
        for portion in portions:
            add(portion)
    table = parquet.read_table(path)
    return table, json.loads(table.schema.metadata[b"geo"])


def test_flatgeobuf_has_every_row_and_a_spatial_index(tmp_path):
    write_flatgeobuf(tmp_path / "outlines.fgb", layer(), "EPSG:28992")
    meta, _, geometry, columns = pyogrio.raw.read(tmp_path / "outlines.fgb")
    columns = dict(zip(meta["fields"], columns, strict=True))
    order = np.argsort(columns["number"])
    assert meta["crs"] == "EPSG:28992"
    assert shapely.from_wkb(geometry[order]).tolist() == list(layer().geometries)
    assert columns["name"][order].tolist() == [None, "é", "é", "é", "é"]
    assert np.isnan(columns["height"][order][2])
    assert pyogrio.read_info(tmp_path / "outlines.fgb")["capabilities"]["fast_spatial_filter"]


def test_geoparquet_has_every_row_of_every_portion(tmp_path):
    table, geo = written_parquet(tmp_path / "outlines.parquet", layer(2), layer(3))
    assert table["number"].to_pylist() == [0, 1, 0, 1, 2]
    assert table["name"].to_pylist() == [None, "é", None, "é", "é"]
    assert table["height"].to_pylist() == [0.0, 1.5, 0.0, 1.5, None]
    expected = [*layer(2).geometries, *layer(3).geometries]
    assert shapely.from_wkb(table["geometry"].to_pylist()).tolist() == expected
    column = geo["columns"][geo["primary_column"]]
    assert (column["encoding"], column["geometry_types"]) == ("WKB", ["Polygon"])
    assert column["bbox"] == [0.0, 0.0, 25.0, 3.0]
    assert pyproj.CRS.from_json_dict(column["crs"]).to_epsg() == 28992


def test_layers_without_rows_and_reference_system_are_sound(tmp_path):
    nothing = layer(0, kind="Polygon Z")
    write_flatgeobuf(tmp_path / "a.fgb", nothing, "")
    assert pyogrio.read_info(tmp_path / "a.fgb")["geometry_type"] == "Polygon Z"
    table, geo = written_parquet(tmp_path / "a.parquet", nothing, crs="")
    assert (len(table), geo["columns"]["geometry"]["crs"]) == (0, None)
