"""GeoPackage: layers, types, holes, heights; whole files or none; and reading polygons of any kind."""

import hashlib
import math
import os
import subprocess
import sys

import numpy as np
import pyogrio
import pyproj
import pytest
import shapely
from support.vector_files import write_geopackage, write_vectors

from lidar_buildings.core.model.errors import InputError, OutputError
from lidar_buildings.io.models.survey_building import BUILDING_FIELDS
from lidar_buildings.io.vectors import layers
from lidar_buildings.io.vectors.layers import VectorLayer, read_polygons

HOUSE = shapely.Polygon(
    [(0, 0), (10, 0), (10, 10), (0, 10)], [[(4, 4), (4, 6), (6, 6), (6, 4)], [(1, 1), (1, 2), (2, 2), (2, 1)]]
)
SHED = shapely.Polygon([(20, 0), (24, 0), (22, 3)])
FIELDS = {"building_id": int, "status": str, "height": float, "n_planes": int}
ROWS = [
    {"building_id": 2**32 - 1, "status": "ok", "height": 6.25, "n_planes": None},
    {"building_id": 1, "status": "no_solid", "height": None},
]


def layer(name="outlines", polygons=(HOUSE, SHED), rows=ROWS, **options):
    return VectorLayer(name, list(polygons), FIELDS, list(rows), **options)


def test_polygons_and_attributes_come_back_as_they_were_with_their_types(tmp_path):
    path = tmp_path / "buildings.gpkg"
    write_geopackage(path, [layer()], "EPSG:28992")
    polygons, attributes, crs = read_polygons(path)
    assert crs == "EPSG:28992"
    assert [polygon.equals_exact(given) for polygon, given in zip(polygons, [HOUSE, SHED], strict=True)] == [
        True
    ] * 2
    assert len(polygons[0].interiors) == 2
    assert attributes["building_id"].tolist() == [2**32 - 1, 1]
    assert attributes["status"].tolist() == ["ok", "no_solid"]
    assert attributes["height"][0] == 6.25
    assert math.isnan(attributes["height"][1])
    info = pyogrio.read_info(path, layer="outlines")
    assert dict(zip(info["fields"], info["ogr_types"], strict=True)) == {
        "building_id": "OFTInteger64",
        "status": "OFTString",
        "height": "OFTReal",
        "n_planes": "OFTInteger64",
    }
    # A whole-number column with nulls is read as floats, null as not a number.
    assert np.isnan(read_polygons(path)[1]["n_planes"]).all()


def test_several_layers_stand_in_one_file_even_empty_ones_also_first(tmp_path):
    path = tmp_path / "buildings.gpkg"
    faces = VectorLayer(
        "roof_faces", [shapely.force_3d(HOUSE, 16.5)], {"building_id": int}, [{"building_id": 5}], "Polygon Z"
    )
    empty = VectorLayer("traced", [], BUILDING_FIELDS, [])
    write_geopackage(path, [layer(), empty, faces], "EPSG:28992")
    kinds = dict(pyogrio.list_layers(path).tolist())
    assert kinds == {"outlines": "Polygon", "traced": "Polygon", "roof_faces": "Polygon Z"}
    assert list(pyogrio.read_info(path, layer="traced")["fields"]) == list(BUILDING_FIELDS)
    nothing, attributes, _ = read_polygons(path, "traced")
    assert len(nothing) == 0
    assert set(attributes) == set(BUILDING_FIELDS)
    ((face,), _, _) = read_polygons(path, "roof_faces")
    assert {z for _, _, z in face.exterior.coords} == {16.5}
    assert len(face.interiors) == 2
    write_geopackage(path, [layer(polygons=[], rows=[]), layer("traced")], "")
    assert len(read_polygons(path)[0]) == 0
    assert len(read_polygons(path, "traced")[0]) == 2


@pytest.mark.parametrize("crs", ["EPSG:2154", ""])
def test_the_reference_system_is_kept_or_unknown(tmp_path, crs):
    path = tmp_path / "buildings.gpkg"
    write_geopackage(path, [layer()], crs)
    assert read_polygons(path)[2] == crs


def test_a_reference_system_without_code_is_kept_as_text(tmp_path):
    path = tmp_path / "buildings.gpkg"
    wkt = pyproj.CRS.from_proj4("+proj=tmerc +lat_0=1 +lon_0=2 +x_0=3 +ellps=bessel +units=m").to_wkt()
    write_geopackage(path, [layer()], wkt)
    projection = pyproj.CRS.from_user_input(read_polygons(path)[2]).coordinate_operation
    assert [parameter.value for parameter in projection.params] == [1.0, 2.0, 1.0, 3.0, 0.0]


def test_equal_content_gives_equal_bytes(tmp_path):
    digests = set()
    for name in ("a.gpkg", "b.gpkg"):
        write_geopackage(tmp_path / name, [layer(), layer("traced")], "EPSG:28992")
        digests.add(hashlib.sha256((tmp_path / name).read_bytes()).hexdigest())
    assert len(digests) == 1


def test_an_existing_file_is_replaced_and_nothing_else_is_left(tmp_path):
    path = tmp_path / "buildings.gpkg"
    write_geopackage(path, [layer(), layer("old")], "EPSG:28992")
    write_geopackage(path, [layer(polygons=[SHED], rows=ROWS[1:])], "EPSG:28992")
    assert len(pyogrio.list_layers(path)) == 1
    assert [one.name for one in tmp_path.iterdir()] == ["buildings.gpkg"]


def test_a_failure_leaves_the_old_file_and_no_scraps(tmp_path, monkeypatch):
    path = tmp_path / "buildings.gpkg"
    write_geopackage(path, [layer()], "EPSG:28992")
    before = path.read_bytes()
    full = OSError(28, "No space left on device")

    def no_space(*_arguments):
        raise full

    monkeypatch.setattr(layers, "check_complete", no_space)
    with pytest.raises(OutputError, match="No space left"):
        write_geopackage(path, [layer(), layer("traced")], "EPSG:28992")
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == ["buildings.gpkg"]


def test_a_file_with_too_few_polygons_is_not_handed_out(tmp_path, monkeypatch):
    write = layers.write_layer

    def lossy(path, content, crs, **options):
        write(path, layer(content.name, content.geometries[:1], content.rows[:1]), crs, **options)

    monkeypatch.setattr(layers, "write_layer", lossy)
    with pytest.raises(OutputError, match="1 of 2"):
        write_geopackage(tmp_path / "buildings.gpkg", [layer()], "")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_and_a_reference_system_that_is_none_are_refused(tmp_path):
    with pytest.raises(OutputError, match="nowhere"):
        write_geopackage(tmp_path / "nowhere" / "buildings.gpkg", [layer()], "")
    with pytest.raises(OutputError, match="cannot be written"):
        write_geopackage(tmp_path / "buildings.gpkg", [layer()], "EPSG:nonsense")


def test_parts_of_multi_polygons_stand_one_by_one_and_what_is_no_polygon_is_left_out(tmp_path):
    path = tmp_path / "footprints.geojson"
    shapes = [shapely.MultiPolygon([HOUSE, SHED]), shapely.Point(1, 1), SHED]
    write_vectors(path, shapes, crs="EPSG:4326", kind="Unknown", columns={"number": [10, 20, 30]})
    polygons, attributes, crs = read_polygons(path)
    assert [polygon.area for polygon in polygons] == [HOUSE.area, SHED.area, SHED.area]
    assert attributes["number"].tolist() == [10, 10, 30]
    assert crs == "EPSG:4326"
    path = write_vectors(tmp_path / "holey.gpkg", [None, SHED])
    assert len(read_polygons(path)[0]) == 1


def test_missing_and_unreadable_files_missing_layers_and_tables_without_geometry_are_named(tmp_path):
    with pytest.raises(InputError, match=r"absent\.gpkg: no such file"):
        read_polygons(tmp_path / "absent.gpkg")
    broken = tmp_path / "broken.gpkg"
    broken.write_bytes(b"no polygons here")
    with pytest.raises(InputError, match=r"broken\.gpkg: cannot be read"):
        read_polygons(broken)
    path = tmp_path / "buildings.gpkg"
    write_geopackage(path, [layer()], "")
    with pytest.raises(InputError, match=r"roofs.*outlines"):
        read_polygons(path, "roofs")
    table = tmp_path / "table.csv"
    table.write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match=r"table\.csv"):
        read_polygons(table)


@pytest.mark.real_data
def test_a_real_base_map_is_read(data_folder):
    polygons, _, crs = read_polygons(data_folder / "delft" / "buildings_nw.gpkg")
    assert len(polygons) >= 87
    assert crs == "EPSG:28992"


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores are chosen on Linux alone")
def test_the_number_of_cores_changes_no_byte(tmp_path):
    script = """
import os, sys
from pathlib import Path
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: int(sys.argv[1])])
import shapely
from lidar_buildings.io.vectors.layers import VectorLayer, geopackage_file
with geopackage_file(Path(sys.argv[2]), "EPSG:28992") as add:
    for numbers in ([], range(9)):
        polygons = [shapely.box(i, 0, i + 1, 1) for i in numbers]
        add(VectorLayer("outlines", polygons, {"n": int}, [{"n": i} for i in numbers]))
"""
    paths = [tmp_path / f"{n}.gpkg" for n in (1, 2)]
    for n, path in enumerate(paths, start=1):
        subprocess.run([sys.executable, "-c", script, str(n), str(path)], check=True)
    assert paths[0].read_bytes() == paths[1].read_bytes()
