"""
The files of a survey's buildings: GeoPackage layers read by GDAL, order, repetition, empty surveys, formats.
"""

import json
import re
import sqlite3
from contextlib import closing
from xml.etree import ElementTree

import ezdxf
import numpy as np
import pyogrio
import pytest
import shapely
from support import model_survey
from support.cjio_process import cjio
from support.made_results import bytes_of
from support.model_survey import DUTCH, FEET, FOOT
from support.source_tree import ROOT

from lidar_buildings.core.model.errors import InputError, OutputError
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.io.models.other_names import OTHER_NAMES
from lidar_buildings.io.models.survey_building import BUILDING_FIELDS, ModelHeading, TerrainMesh
from lidar_buildings.io.models.tiles3d import EarthFrame
from lidar_buildings.io.results import building_files
from lidar_buildings.io.results.building_files import write_buildings
from lidar_buildings.io.results.building_layers import LAYERS, STREET_LAYERS
from lidar_buildings.io.results.layer_looks import MEANINGS
from lidar_buildings.io.results.output_config import FORMAT_FILES, OutputConfig
from lidar_buildings.io.results.tile_products import Shapes
from lidar_buildings.io.vectors.layers import read_polygons

NAMES = [
    "buildings.gpkg",
    "city_model.city.jsonl",
    "city_model.city.json",
    "city_model.obj",
    "city_model.mtl",
    "city_model.dxf",
    "tiles3d",
]


#: Those of the formats that are written unless others are chosen.
FILES = {name: FORMAT_FILES[name] for name in OutputConfig().formats if name in FORMAT_FILES}


def written(folder, *tiles, frame=DUTCH, formats=tuple(FILES), title="", **options):
    """Write tiles in some formats, and return what the writer says."""
    folder.mkdir(exist_ok=True)
    with model_survey.survey(folder, *tiles, frame=frame, **options) as survey:
        heading = ModelHeading(title, earth=EarthFrame(frame, frame.crs))
        return write_buildings(folder, survey, formats, heading)


@pytest.fixture(scope="module")
def dutch(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    return folder, *written(folder, model_survey.shapes(), title="Buildings of a")


@pytest.fixture(scope="module")
def feet(tmp_path_factory):
    folder = tmp_path_factory.mktemp("feet")
    written(folder, model_survey.shapes(FEET), frame=FEET, formats=["gpkg"])
    return folder


def test_all_files_and_layers_are_named_and_buildings_counted_by_status(dutch):
    folder, files, counts = dutch
    assert files == NAMES
    assert all((folder / name).exists() for name in files)
    assert counts.statuses == {"degenerate": 1, "ok": 4}
    layers = pyogrio.list_layers(dutch[0] / "buildings.gpkg").tolist()
    assert layers == [
        ["outlines", "Polygon"],
        ["traced", "Polygon"],
        ["roof_faces", "Polygon Z"],
        ["roof_lines", "LineString Z"],
        ["roof_corners", "Point Z"],
        ["layer_styles", None],
    ]


def test_outlines_have_every_attribute_and_every_building(dutch):
    polygons, columns, crs = read_polygons(dutch[0] / "buildings.gpkg", "outlines")
    assert crs == "EPSG:28992"
    assert set(columns) == {*BUILDING_FIELDS, "readable_id"}
    assert columns["building_id"].tolist() == [2, 3, 5, 7, 9]
    assert columns["volume"][2] == pytest.approx(360.0)
    assert np.isnan(columns["volume"][3])
    assert columns["plane_sigma"][0] == 0.02
    assert columns["no_data_share"][0] == 0.125
    assert columns["reason"][3] == "no roof points"
    assert [len(polygon.interiors) for polygon in polygons] == [0, 0, 0, 0, 1]


def test_layers_have_styles_of_their_columns_and_every_column_a_meaning(dutch):
    path = dutch[0] / "buildings.gpkg"
    names = ["f_table_name", "styleName", "styleQML"]
    styles = pyogrio.raw.read(path, layer="layer_styles", columns=names)[3]
    assert [tuple(one) for one in zip(*styles[:2], strict=True)] == [
        ("outlines", "grade"),
        ("outlines", "height"),
        ("roof_faces", "slope"),
    ]
    for layer, qml in zip(styles[0], styles[2], strict=True):
        renderer = ElementTree.fromstring(qml).find("renderer-v2")
        assert renderer.get("attr") in pyogrio.read_info(path, layer=layer)["fields"]
        used = {one.get("symbol") for one in renderer[0]}
        assert used == {one.get("name") for one in renderer.find("symbols")}
    with closing(sqlite3.connect(path)) as file:
        told = file.execute("SELECT column_name, title FROM gpkg_data_columns WHERE table_name = 'outlines'")
        assert ("n_planes", "N planes") in told.fetchall()
    assert {name for columns in (LAYERS | STREET_LAYERS).values() for name in columns} == set(MEANINGS)


def test_the_document_has_what_the_sequence_has(dutch, monkeypatch, tmp_path):
    header, *lines = (dutch[0] / "city_model.city.jsonl").read_text().splitlines()
    document = json.loads((dutch[0] / "city_model.city.json").read_text())
    assert document["transform"] == json.loads(header)["transform"]
    features = [json.loads(line) for line in lines]
    assert list(document["CityObjects"]) == [one["id"] for one in features]
    for one in features:
        theirs, mine = one["CityObjects"][one["id"]], document["CityObjects"][one["id"]]
        assert mine["attributes"] == theirs["attributes"]
        for a, b in zip(mine["geometry"], theirs["geometry"], strict=True):
            numbers = [np.array(re.findall(r"\d+", str(g["boundaries"])), dtype=int) for g in (a, b)]
            vertices = np.array(document["vertices"]), np.array(one["vertices"])
            np.testing.assert_array_equal(vertices[0][numbers[0]], vertices[1][numbers[1]])
    monkeypatch.setattr("lidar_buildings.io.models.cityjson._MOST_IN_DOCUMENT", 4)
    (tmp_path / "city_model.city.json").touch()
    assert written(tmp_path, model_survey.shapes(), formats=["cityjson"])[0] == ["city_model.city.jsonl"]
    assert not (tmp_path / "city_model.city.json").exists()


def test_attributes_stand_under_the_names_of_3dbag_as_well(tmp_path):
    with model_survey.survey(tmp_path, model_survey.shapes(), names="3dbag") as survey:
        fields = BUILDING_FIELDS | OTHER_NAMES["3dbag"]
        write_buildings(tmp_path, survey, ["gpkg", "cityjson"], ModelHeading(fields=fields))
    _, columns, _ = read_polygons(tmp_path / "buildings.gpkg", "outlines")
    assert set(fields) <= set(columns)
    assert columns["b3_dak_type"].tolist()[1:4] == ["multiple horizontal", "slanted", "no points"]
    assert columns["b3_opp_dak_schuin"][2] == pytest.approx(100.0)
    assert columns["b3_volume_lod22"][2] == columns["volume"][2]
    lines = (tmp_path / "city_model.city.jsonl").read_text().splitlines()[1:]
    things = [one["attributes"] for line in lines for one in json.loads(line)["CityObjects"].values()]
    assert [one["b3_n_vlakken"] for one in things if one["building_id"] == 5] == [2]


def test_every_attribute_is_explained():
    page = (ROOT / "doc" / "formats.md").read_text(encoding="utf-8")
    assert [name for name in BUILDING_FIELDS | OTHER_NAMES["3dbag"] if f"`{name}`" not in page] == []


def test_roof_faces_are_those_of_the_finest_solid_with_their_slopes(dutch):
    polygons, columns, _ = read_polygons(dutch[0] / "buildings.gpkg", "roof_faces")
    assert columns["building_id"].tolist() == [2, 3, 3, 5, 5, 9]
    assert columns["face"].tolist() == [1, 1, 2, 1, 2, 1]
    assert set(columns["lod"]) == {"2.2"}
    assert columns["slope_deg"] == pytest.approx([0, 0, 0, 36.8699, 36.8699, 0], abs=1e-4)
    assert columns["azimuth_deg"][3:5].tolist() == [180.0, 0.0]
    assert np.isnan(columns["azimuth_deg"][[0, 1, 2, 5]]).all()
    assert columns["area"][3:] == pytest.approx([50.0, 50.0, 400.0 - 64.0])
    assert columns["elevation_min"][3:5].tolist() == [model_survey.EAVE] * 2
    assert columns["elevation_max"][3:5].tolist() == [model_survey.RIDGE] * 2
    assert all(polygon.has_z for polygon in polygons)
    assert polygons[3].bounds == (84900.0, 447400.0, 84910.0, 447404.0)
    assert len(polygons[5].interiors) == 1


@pytest.mark.parametrize("survey", ["dutch", "feet"])
def test_each_face_lies_in_the_plane_of_its_equation(survey, request):
    found = request.getfixturevalue(survey)
    folder = found[0] if survey == "dutch" else found
    polygons, columns, _ = read_polygons(folder / "buildings.gpkg", "roof_faces")
    for polygon, a, b, c in zip(polygons, *(columns[f"plane_{one}"] for one in "abc"), strict=True):
        x, y, z = np.array(polygon.exterior.coords).T
        assert a * x + b * y + c == pytest.approx(z, abs=2e-3)


def test_roof_lines_have_their_kinds_and_faces(dutch):
    path = dutch[0] / "buildings.gpkg"
    meta, _, geometry, columns = pyogrio.raw.read(path, layer="roof_lines")
    columns = dict(zip(meta["fields"], columns, strict=True))
    ridge = np.flatnonzero(columns["kind"] == "ridge")
    assert columns["building_id"][ridge].tolist() == [5]
    assert [columns[name][ridge[0]] for name in ("face", "other_face", "length")] == [1, 2, 10.0]
    assert list(shapely.from_wkb(geometry[ridge[0]]).coords) == [
        (84910.0, 447404.0, model_survey.RIDGE),
        (84900.0, 447404.0, model_survey.RIDGE),
    ]


@pytest.mark.parametrize(("survey", "unit"), [("dutch", 1.0), ("feet", FOOT)])
def test_corners_lines_and_faces_say_how_sure_they_are(survey, unit, request):
    found = request.getfixturevalue(survey)
    path = (found[0] if survey == "dutch" else found) / "buildings.gpkg"
    meta, _, geometry, columns = pyogrio.raw.read(path, layer="roof_corners")
    columns = dict(zip(meta["fields"], columns, strict=True))
    ridge = (columns["building_id"] == 5) & (columns["kind"] == "ridge")
    assert ridge.sum() == 2
    for name, sigma in zip(("sigma_x", "sigma_y", "sigma_z"), model_survey.SIGMAS, strict=True):
        assert columns[name][ridge] == pytest.approx(sigma / unit, abs=1e-4)
    for point, elevation in zip(shapely.from_wkb(geometry), columns["elevation"], strict=True):
        assert point.z == pytest.approx(elevation, abs=1e-4)
    meta, _, _, columns = pyogrio.raw.read(path, layer="roof_lines")
    columns = dict(zip(meta["fields"], columns, strict=True))
    ridge = columns["kind"] == "ridge"  # along x
    assert columns["sigma_xy"][ridge] == pytest.approx(0.2 / unit, abs=1e-4)
    assert columns["sigma_z"][ridge] == pytest.approx(0.05 / unit, abs=1e-4)
    _, columns, _ = read_polygons(path, "roof_faces")
    assert columns["elevation_sigma"] == pytest.approx(0.02 / unit, abs=1e-4)


def test_feet_come_back_in_feet(feet):
    polygons, columns, _ = read_polygons(feet / "buildings.gpkg", "roof_faces")
    assert columns["area"][3] == pytest.approx(50.0 / FOOT**2, abs=1e-3)
    assert columns["slope_deg"][3] == pytest.approx(36.8699, abs=1e-4)
    assert columns["elevation_max"][3] == pytest.approx((model_survey.RIDGE + 30.0) / FOOT, abs=1e-3)
    assert polygons[3].bounds[0] == pytest.approx(300000.0 / FOOT)
    _, columns, _ = read_polygons(feet / "buildings.gpkg", "outlines")
    assert columns["volume"][2] == pytest.approx(360.0 / FOOT**3, abs=1e-2)
    assert columns["plane_sigma"][2] == pytest.approx(0.02 / FOOT, abs=1e-4)


def test_all_formats_name_the_same_buildings(dutch):
    folder = dutch[0]
    _, columns, _ = read_polygons(folder / "buildings.gpkg", "outlines")
    names = columns["readable_id"].tolist()
    lines = (folder / "city_model.city.jsonl").read_text().splitlines()
    assert [json.loads(line)["id"] for line in lines[1:]] == names
    mesh, drawing = ((folder / name).read_text() for name in ("city_model.obj", "city_model.dxf"))
    assert all(name in mesh and name in drawing for name in names)


def test_the_terrain_stands_behind_the_buildings_in_every_model(tmp_path):
    vertices = np.array([[0.0, 0, 1], [10, 0, 1], [10, 10, 2], [0, 10, 1]])
    mesh = TerrainMesh("terrain-84800.0-447500.0", vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    with model_survey.survey(tmp_path, model_survey.shapes()) as survey:
        write_buildings(tmp_path, survey, tuple(FILES), ModelHeading(), [mesh])
    lines = (tmp_path / "city_model.city.jsonl").read_text().splitlines()
    assert json.loads(lines[-1])["CityObjects"][mesh.name]["type"] == "TINRelief"
    result = cjio("stdin", "save", str(tmp_path / "model.city.json"), lines=lines)
    assert result.returncode == 0, result.stdout + result.stderr
    *_, thing = json.loads((tmp_path / "model.city.json").read_text())["CityObjects"].values()
    assert thing["geometry"][0]["type"] == "CompositeSurface"
    obj = (tmp_path / "city_model.obj").read_text().split(f"o {mesh.name}\n")[1].splitlines()
    assert [line.split()[0] for line in obj] == ["v"] * 4 + ["usemtl"] + ["f"] * 2
    assert "newmtl terrain" in (tmp_path / "city_model.mtl").read_text()
    drawing = ezdxf.readfile(tmp_path / "city_model.dxf")
    faces = drawing.modelspace().query('3DFACE[layer=="TERRAIN"]')
    assert [tuple(faces[1].dxf.get(f"vtx{k}")) for k in (0, 2)] == [(84900, 447400, 1), (84900, 447410, 1)]
    assert not drawing.audit().has_errors


def test_cjio_reads_all_levels_and_the_header_tells_extent_and_title(dutch, tmp_path):
    lines = (dutch[0] / "city_model.city.jsonl").read_text().splitlines()
    merged = tmp_path / "model.city.json"
    result = cjio("stdin", "save", str(merged), lines=lines)
    assert result.returncode == 0, result.stdout + result.stderr
    model = json.loads(merged.read_text())
    levels = [[one["lod"] for one in thing["geometry"]] for thing in model["CityObjects"].values()]
    assert sorted(levels) == [[]] + [["1.2", "2.2"]] * 4
    metadata = json.loads(lines[0])["metadata"]
    assert metadata["title"] == "Buildings of a"
    assert metadata["geographicalExtent"] == [84900, 447400, 1, 84965, 447440, 9]


def test_no_buildings_give_files_that_are_sound_and_empty(tmp_path):
    files, counts = written(tmp_path, model_survey.shapes(buildings={}))
    assert files == NAMES
    assert counts.statuses == {}
    for layer in ("outlines", "traced", "roof_faces"):
        assert pyogrio.read_info(tmp_path / "buildings.gpkg", layer=layer)["features"] == 0
    (header,) = (tmp_path / "city_model.city.jsonl").read_text().splitlines()
    assert "geographicalExtent" not in json.loads(header)["metadata"]


def test_the_result_does_not_depend_on_how_buildings_are_cut_into_tiles(dutch, tmp_path):
    tiles = [model_survey.shapes(buildings={n: b}) for n, b in model_survey.BUILDINGS.items()]
    written(tmp_path, *tiles, *tiles[:2], title="Buildings of a")
    assert bytes_of(tmp_path) == bytes_of(dutch[0])


def test_many_buildings_are_written_in_portions_to_the_same_layers(dutch, tmp_path, monkeypatch):
    monkeypatch.setattr("lidar_buildings.io.results.building_layers._PORTION", 3)
    written(tmp_path, model_survey.shapes(), formats=["gpkg"])
    for layer in ("outlines", "traced", "roof_faces"):
        mine, theirs = (read_polygons(f / "buildings.gpkg", layer) for f in (tmp_path, dutch[0]))
        assert [p.wkb for p in mine[0]] == [p.wkb for p in theirs[0]]
        for name, column in theirs[1].items():
            np.testing.assert_array_equal(mine[1][name], column)


@pytest.mark.parametrize("name", FORMAT_FILES)
def test_formats_can_be_chosen(tmp_path, name):
    files, counts = written(tmp_path, model_survey.shapes(), formats=[name])
    assert files == list(FORMAT_FILES[name])
    assert {p.name for p in tmp_path.iterdir()} == {"lines", *files}
    assert counts.statuses == {"degenerate": 1, "ok": 4}


def test_buildings_to_leave_out_are_in_no_file(tmp_path):
    written(tmp_path, model_survey.shapes(), without={5, 9})
    _, columns, _ = read_polygons(tmp_path / "buildings.gpkg", "outlines")
    assert columns["building_id"].tolist() == [2, 3, 7]
    assert "building-84900" not in (tmp_path / "city_model.obj").read_text()


def test_outlines_without_models_are_named_and_measured(tmp_path):
    square = BuildingOutline(4, Outline(model_survey.rectangle(10, 0, 14, 4)))
    _, counts = written(tmp_path, Shapes((square,), (square,), ()), formats=["gpkg"])
    assert counts.statuses == {"unknown": 1}
    _, columns, _ = read_polygons(tmp_path / "buildings.gpkg", "outlines")
    assert columns["area"].tolist() == [16.0]
    assert columns["readable_id"].tolist() == ["building-84910.0-447400.0"]


def test_names_of_footprints_stand_where_there_is_no_model(tmp_path):
    square = BuildingOutline(4, Outline(model_survey.rectangle(10, 0, 14, 4)))
    written(tmp_path, Shapes((square,), (square,), ()), formats=["gpkg"], footprint_id={4: "plot 12"})
    _, columns, _ = read_polygons(tmp_path / "buildings.gpkg", "outlines")
    assert columns["footprint_id"].tolist() == ["plot 12"]


def test_models_get_the_names_of_their_footprints(tmp_path):
    names = {5: "seven", 3: "ächt"}
    written(tmp_path, model_survey.shapes(), formats=["cityjson"], footprint_id=names)
    _, *lines = (tmp_path / "city_model.city.jsonl").read_text(encoding="utf-8").splitlines()
    found = [next(iter(json.loads(line)["CityObjects"].values()))["attributes"] for line in lines]
    told = {each["building_id"]: each["footprint_id"] for each in found}
    assert told == {2: "", 3: "ächt", 5: "seven", 7: "", 9: ""}
    assert all(list(each) == sorted(each) for each in found)
    assert any("ächt" in line for line in lines)


def test_a_line_that_is_no_feature_gets_no_name(tmp_path):
    with pytest.raises(InputError, match="no CityJSONFeature"):
        written(tmp_path, Shapes((), (), ("{}",)), footprint_id={})


def test_a_failure_leaves_no_file_of_any_format(tmp_path, monkeypatch):
    def fail(self):
        raise OutputError("disk full")

    monkeypatch.setattr(building_files.SurveyBuilding, "pieces", property(fail))
    with pytest.raises(OutputError, match="disk full"):
        written(tmp_path, model_survey.shapes())
    assert [p.name for p in tmp_path.iterdir()] == ["lines"]


def test_two_buildings_with_one_id_keep_their_own_models(tmp_path):
    # ids repeat 32 km apart; the names tell such buildings apart
    near, far = model_survey.shapes(buildings={5: model_survey.gable}), far_gable()
    written(tmp_path, near, far)
    _, columns, _ = read_polygons(tmp_path / "buildings.gpkg", "outlines")
    assert columns["building_id"].tolist() == [5, 5]
    assert columns["readable_id"].tolist() == ["building-117668.0-447400.0", "building-84900.0-447400.0"]
    assert len((tmp_path / "city_model.city.jsonl").read_text().splitlines()) == 3


@pytest.mark.parametrize("names", [None, {5: "five"}])
def test_a_building_whose_anchor_moved_on_is_there_once(tmp_path, names):
    # another tile had it before what lies farther west was scanned
    def grown():
        outline, model = model_survey.gable()
        return Outline(np.add(outline.exterior, (-0.2, 0.0))), model

    near, again = (model_survey.shapes(buildings={5: one}) for one in (model_survey.gable, grown))
    _, counts = written(tmp_path, near, again, footprint_id=names)
    assert counts.statuses == {"ok": 1}
    assert len((tmp_path / "city_model.city.jsonl").read_text().splitlines()) == 2


def far_gable():
    """The gable house once more, 32,768 m to the east."""

    def moved():
        outline, model = model_survey.gable()
        solids = {
            lod: type(solid)(np.add(solid.vertices, (32768.0, 0.0, 0.0)), solid.faces, solid.semantics)
            for lod, solid in model.solids.items()
        }
        return Outline(np.add(outline.exterior, (32768.0, 0.0))), BuildingModel(solids, model.attributes)

    return model_survey.shapes(buildings={5: moved})
