"""What Python calls gives what the command does."""

import json

import numpy as np
import pytest

import lidar_buildings as lb
from lidar_buildings.core.model.errors import InputError, OutputError, ParameterError

FEW = {"model_writer": {"formats": ["gpkg", "cityjson"], "raster_resolution": 0.0}}


@pytest.fixture(scope="module")
def result(house):
    return lb.reconstruct([house], **FEW)


def test_a_result_is_that_of_the_files(result):
    (row,) = result.to_geodataframe().to_dict("records")
    city = result.to_cityjson()
    building = city["CityObjects"][row["readable_id"]]
    assert building["attributes"]["height"] == row["height"]
    used = {
        corner
        for one in building["geometry"]
        for face in one["boundaries"][0]
        for ring in face
        for corner in ring
    }
    scale, move = city["transform"]["scale"], city["transform"]["translate"]
    corners = np.array(city["vertices"])[sorted(used)] * scale + move
    x, y = corners[:, :2].T
    # Models stand on walls that planes may have moved by centimetres.
    assert [x.min(), y.min(), x.max(), y.max()] == pytest.approx(row["geometry"].bounds, abs=0.02)
    assert repr(result) == f"<Reconstruction of 1 building in {result.folder}>"


def test_a_result_is_kept_where_it_is_written(result, tmp_path):
    kept = lb.Reconstruction(result.write(tmp_path / "kept"))
    assert kept.run == result.run
    with pytest.raises(OutputError, match="finished run"):
        result.write(tmp_path / "kept")
    result.write(tmp_path / "kept", overwrite=True)
    files = [sorted(x.relative_to(one.folder) for x in one.folder.rglob("*")) for one in (result, kept)]
    assert files[0] == files[1]


def test_points_in_memory_give_the_buildings_of_their_file(result, house, tmp_path):
    tile = lb.read(house / "strip_01.laz")
    x, y, _ = tile.world.mean(axis=0)
    west, south, east, north = result.to_geodataframe().total_bounds
    assert west < x < east
    assert south < y < north
    of_tile = lb.reconstruct(tile, tmp_path / "tile", until="regularisation", **FEW)
    of_array = lb.reconstruct(tile.world, crs="EPSG:25832", until="regularisation", **FEW)
    for found in (of_tile.to_geodataframe(), of_array.to_geodataframe()):
        assert found.crs == "EPSG:25832"
        assert found.union_all().symmetric_difference(result.to_geodataframe().union_all()).area < 2.0
    assert json.loads((tmp_path / "tile" / "run.json").read_text())["n_points"] == len(tile)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda house, result: lb.Reconstruction(house), InputError, "contains no run.json"),
        (lambda house, result: result.to_geodataframe("roofs"), ParameterError, "must be one of"),
        (lambda house, result: result.to_geodataframe("facades"), ParameterError, "has none"),
        (lambda house, result: lb.reconstruct(np.zeros((3, 2))), ParameterError, "must be"),
        (lambda house, result: lb.reconstruct(house, roof_selection=2), ParameterError, "as in"),
        (lambda house, result: lb.reconstruct(house, roofs={"a": 1}), ParameterError, "no stage"),
        (lambda house, result: lb.reconstruct("nowhere"), InputError, "no such file"),
    ],
)
def test_what_cannot_be_is_refused(call, error, words, house, result):
    with pytest.raises(error, match=words):
        call(house, result)
