"""Virtual surveys as files."""

import json

import laspy
import numpy as np
import pyogrio
import pytest
import shapely
from support.cjio_process import cjio

from lidar_buildings.core.model.errors import OutputError, ParameterError
from lidar_buildings.simulation import make_scene, simulate_survey, simulate_tile
from lidar_buildings.simulation.scene import FRAME
from lidar_buildings.simulation.survey import write_truth


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    folder = tmp_path_factory.mktemp("survey")
    return folder, simulate_survey(folder, "dense_block", 1, density=4.0, altitude=100.0, overlap=0.4)


def test_every_strip_is_a_raw_las_14_file_with_a_reference_system_and_nothing_else_is_left(survey):
    folder, summary = survey
    names = [path.name for path in summary.files]
    assert len(names) >= 2
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        [*names, "truth.city.jsonl", "truth.gpkg"]
    )
    _, summary = survey
    n_points = 0
    for number, path in enumerate(summary.files, start=1):
        las = laspy.read(path)
        assert (str(las.header.version), las.header.point_format.id) == ("1.4", 6)
        assert las.header.parse_crs().to_epsg() == 25832
        assert las.header.global_encoding.wkt
        assert las.header.global_encoding.gps_time_type == laspy.header.GpsTimeType.STANDARD
        assert set(las.classification) == {1}
        assert set(las.point_source_id) == {number}
        assert (np.asarray(las.return_number) <= np.asarray(las.number_of_returns)).all()
        assert np.abs(las.scan_angle * 0.006).max() <= 20.01
        n_points += len(las)
    assert n_points == summary.n_points


def test_files_and_tile_hold_the_same_points_and_truth(survey):
    _, summary = survey
    files = [laspy.read(path) for path in summary.files]
    tile, truth = simulate_tile("dense_block", 1, density=4.0, altitude=100.0, overlap=0.4)
    xyz = np.concatenate([las.xyz for las in files])
    assert np.abs(tile.frame.to_source(tile.points) - xyz).max() < 0.001
    for name, expected in (
        ("TrueClass", truth.classification),
        ("TrueBuilding", truth.building),
        ("TruePlane", truth.plane),
        ("intensity", tile.intensity),
        ("gps_time", tile.gps_time),
    ):
        assert np.array_equal(np.concatenate([las[name] for las in files]), expected)


def test_the_outlines_hold_the_roof_points_and_courts(survey, tmp_path):
    folder, summary = survey
    write_truth(tmp_path, make_scene("courtyards"))
    meta, _, wkb, columns = pyogrio.raw.read(folder / "truth.gpkg", layer="outlines")
    table = dict(zip(meta["fields"], columns, strict=True))
    polygons = shapely.from_wkb(wkb)
    assert meta["crs"] == "EPSG:25832"
    assert len(polygons) == summary.n_buildings == 16
    assert shapely.is_valid(polygons).all()
    assert np.allclose(table["area"], shapely.area(polygons))
    assert (table["height"] > 5).all()
    _, _, courts, _ = pyogrio.raw.read(tmp_path / "truth.gpkg", layer="outlines")
    assert shapely.get_num_interior_rings(shapely.from_wkb(courts)).tolist() == [1, 1, 1, 1]
    points = laspy.read(summary.files[0])
    for number, polygon in zip(table["building_number"], polygons, strict=True):
        rows = (points.TrueBuilding == number) & (points.TruePlane > 0)
        # Five σ of the planimetric noise and the beam's width.
        assert shapely.intersects_xy(polygon.buffer(0.25), points.x[rows], points.y[rows]).all()


def test_the_roof_faces_are_plane_in_three_dimensions(survey):
    folder, _ = survey
    _, _, wkb, columns = pyogrio.raw.read(folder / "truth.gpkg", layer="roof_faces")
    faces = shapely.from_wkb(wkb)
    assert len(faces) == sum(len(b.faces) for b in make_scene("dense_block", 1).buildings)
    for face, area in zip(faces, columns[3], strict=True):
        corners = shapely.get_coordinates(face, include_z=True)
        corners -= corners.mean(axis=0)
        assert np.linalg.svd(corners, compute_uv=False)[2] < 1e-6
        assert area >= shapely.area(face) - 1e-9


def test_the_city_model_is_a_cityjson_sequence_of_lod22_solids_that_cjio_reads(survey, tmp_path):
    folder, summary = survey
    header, *features = (json.loads(line) for line in (folder / "truth.city.jsonl").open())
    assert (header["type"], header["version"]) == ("CityJSON", "2.0")
    assert header["metadata"]["referenceSystem"].endswith("/EPSG/0/25832")
    assert len(features) == summary.n_buildings
    for feature in features:
        (building,) = feature["CityObjects"].values()
        (solid,) = building["geometry"]
        (shell,) = solid["boundaries"]
        assert solid["lod"] == "2.2"
        assert len(solid["semantics"]["values"][0]) == len(shell)
        used = {vertex for surface in shell for ring in surface for vertex in ring}
        assert used == set(range(len(feature["vertices"])))
    merged = tmp_path / "model.city.json"
    result = cjio("stdin", "save", str(merged), lines=(folder / "truth.city.jsonl").read_text().splitlines())
    assert result.returncode == 0, result.stdout + result.stderr
    model = json.loads(merged.read_text())
    assert sum(one["type"] == "Building" for one in model["CityObjects"].values()) == summary.n_buildings
    scale, shift = (np.array(model["transform"][name]) for name in ("scale", "translate"))
    vertices = np.array(model["vertices"]) * scale + shift
    corner = np.array(FRAME.origin[:2])
    assert (vertices[:, :2] > corner).all()
    assert (vertices[:, :2] < corner + np.array([120, 90])).all()


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    for name in ("one", "two"):
        simulate_survey(tmp_path / name, "single_house", 5)
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()


def test_strips_of_an_earlier_survey_do_not_stay_and_an_empty_scene_has_empty_layers(tmp_path):
    simulate_survey(tmp_path, "dense_block", density=0.5, altitude=100.0, overlap=0.5)
    (tmp_path / "notes.txt").write_text("mine")
    summary = simulate_survey(tmp_path, "flat_terrain_empty", density=0.5)
    assert sorted(tmp_path.glob("*.laz")) == list(summary.files)
    assert (tmp_path / "notes.txt").exists()
    assert summary.n_buildings == 0
    assert pyogrio.read_info(tmp_path / "truth.gpkg", layer="outlines")["features"] == 0
    assert len((tmp_path / "truth.city.jsonl").read_text().splitlines()) == 1


def test_an_unknown_scene_or_parameter_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(ParameterError, match="village"):
        simulate_survey(tmp_path / "new", "town")
    with pytest.raises(ParameterError, match=r"simulation\.desnity"):
        simulate_survey(tmp_path / "new", desnity=3.0)
    with pytest.raises(ParameterError, match=r"simulation\.density = -1\.0: must be within"):
        simulate_survey(tmp_path / "new", density=-1.0)
    assert not (tmp_path / "new").exists()


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(OutputError, match="file"):
        simulate_survey(blocked / "survey", "flat_terrain_empty", density=0.5)
    (tmp_path / "survey" / "strip_01.laz").mkdir(parents=True)
    with pytest.raises(OutputError, match=r"strip_01\.laz: cannot be written"):
        simulate_survey(tmp_path / "survey", "flat_terrain_empty", density=0.5)
    assert [path.name for path in (tmp_path / "survey").iterdir()] == ["strip_01.laz"]
