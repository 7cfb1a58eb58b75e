"""FlatGeobuf: what GDAL reads back, missing values, empty layers."""

import numpy as np
import pyogrio
import shapely

from lidar_buildings.io.vectors.layers import VectorLayer, write_flatgeobuf

FIELDS = {"number": int, "name": str, "height": float}


def layer(n=5, **options):
    shapes = [shapely.box(10.0 * i, 0.0, 10.0 * i + 5.0, 3.0) for i in range(n)]
    rows = [
        {"number": i, "name": "é" if i else None, "height": 1.5 * i if i != 2 else None} for i in range(n)
    ]
    return VectorLayer("outlines", shapes, FIELDS, rows, **options)


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


def test_layers_without_rows_and_reference_system_are_sound(tmp_path):
    nothing = layer(0, kind="Polygon Z")
    write_flatgeobuf(tmp_path / "a.fgb", nothing, "")
    assert pyogrio.read_info(tmp_path / "a.fgb")["geometry_type"] == "Polygon Z"
