"""Buildings in blocks: squares of a quadtree, their files, the index, terrain, any order."""

import json
from collections import Counter

import numpy as np
import pyogrio
import pytest
import shapely
from support import model_survey
from support.made_results import bytes_of
from support.model_survey import DUTCH

from lidar_buildings.core.model.ids import building_id
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.raising import extrude
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.io.models.survey_building import ModelHeading, TerrainMesh
from lidar_buildings.io.models.tiles3d import EarthFrame
from lidar_buildings.io.results.building_files import squares_of, write_in_blocks

FORMATS = ("gpkg", "cityjson", "obj", "3dtiles")
#: South-western corners of houses: three near each other, and two far away [m].
CORNERS = [(10.0, 10.0), (30.0, 10.0), (50.0, 300.0), (900.0, 20.0), (1500.0, 1700.0)]
#: Of 2 km, of which one piece lies by the first house and one outside all squares.
TERRAIN = [
    TerrainMesh(
        name, np.array([[x, 0.0, 0.0], [x + 256.0, 0.0, 0.0], [x, 256.0, 0.0]]), np.array([[0, 1, 2]])
    )
    for name, x in (("terrain-inside", 0.0), ("terrain-outside", -300.0))
]


def house(x, y):
    outline = Outline(model_survey.rectangle(x, y, x + 8.0, y + 6.0))
    return outline, BuildingModel({"1.2": extrude(outline, 0.0, 5.0)}, {"lod": "1.2"})


def houses(corners=CORNERS):
    return {building_id(np.array(corner)): lambda c=corner: house(*c) for corner in corners}


def written(folder, *tiles, frame=DUTCH, largest=2):
    folder.mkdir(exist_ok=True)
    with model_survey.survey(folder, *tiles, frame=frame) as survey:
        heading = ModelHeading(earth=EarthFrame(frame, frame.crs) if frame.crs else None)
        files, counts = write_in_blocks(folder, survey, FORMATS, heading, TERRAIN, largest=largest)
    return files, counts, json.loads((folder / "blocks" / "index.json").read_text())["features"]


@pytest.fixture(scope="module")
def blocks(tmp_path_factory):
    folder = tmp_path_factory.mktemp("blocks")
    return folder, *written(folder, model_survey.shapes(buildings=houses()))


def test_squares_hold_each_place_once_and_at_most_so_many():
    places = np.random.default_rng(0).uniform(-3000.0, 5000.0, (500, 2))
    squares = squares_of(places, 20)
    assert Counter(row for _, rows in squares for row in rows.tolist()) == dict.fromkeys(range(500), 1)
    assert max(len(rows) for _, rows in squares) <= 20
    for square, rows in squares:
        away = places[rows] - [square.west, square.south]
        assert ((away >= 0.0) & (away < square.side)).all()
    assert len({(square.west, square.south) for square, _ in squares}) == len(squares)


def test_squares_are_not_divided_without_end():
    ((square, rows),) = squares_of(np.zeros((9, 2)), 2)
    assert (square.side, len(rows)) == (256.0, 9)


def test_blocks_hold_every_building_once_and_the_index_says_which_files(blocks):
    folder, files, counts, items = blocks
    assert files == ["blocks", "tiles3d"]
    assert counts.statuses == {"ok": len(CORNERS)}
    assert [item["properties"]["buildings"] for item in items] == [2, 1, 1, 1]
    numbers = []
    for item in items:
        for asset in item["assets"].values():
            assert (folder / "blocks" / asset["href"]).stat().st_size == asset["file:size"]
        meta, _, _, columns = pyogrio.raw.read(folder / "blocks" / item["assets"]["outlines.fgb"]["href"])
        own = dict(zip(meta["fields"], columns, strict=True))["building_id"].tolist()
        assert len(own) == item["properties"]["buildings"]
        lines = (folder / "blocks" / item["id"] / "city_model.city.jsonl").read_text().splitlines()
        assert sum('"Building"' in line for line in lines) == len(own)
        numbers += own
    assert sorted(numbers) == sorted(houses())


def test_the_index_says_where_blocks_lie_in_the_source_and_on_the_earth(blocks):
    for item in blocks[3]:
        meta, _, geometry, _ = pyogrio.raw.read(blocks[0] / "blocks" / item["id"] / "outlines.fgb")
        assert item["properties"]["proj:code"] == meta["crs"] == "EPSG:28992"
        assert item["properties"]["proj:bbox"] == shapely.total_bounds(shapely.from_wkb(geometry)).tolist()
        west, south, east, north = item["bbox"]
        assert 4.36 < west < east < 4.40
        assert 52.0 < south < north < 52.04


def test_each_piece_of_terrain_is_in_one_block_the_nearest(blocks):
    folder, *_, items = blocks
    texts = [(folder / "blocks" / item["id"] / "city_model.obj").read_text() for item in items]
    assert [sum(mesh.name in text for text in texts) for mesh in TERRAIN] == [1, 1]
    first = next(text for text in texts if "building-84910.0-447410.0" in text)
    assert all(mesh.name in first for mesh in TERRAIN)


def test_blocks_are_the_same_however_buildings_came(blocks, tmp_path):
    tiles = [model_survey.shapes(buildings={n: b}) for n, b in reversed(houses().items())]
    written(tmp_path, *tiles)
    assert bytes_of(tmp_path) == bytes_of(blocks[0])


def test_blocks_of_an_unknown_system_have_no_place_on_the_earth(tmp_path):
    files, _, items = written(tmp_path, model_survey.shapes(buildings=houses()), frame=MapFrame())
    assert files == ["blocks"]
    assert {item["geometry"] for item in items} == {None}
    assert not any("proj:code" in item["properties"] for item in items)
