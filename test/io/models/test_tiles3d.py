"""3D Tiles: where vertices lie on the earth, attributes, the tree, heights, and surveys that lie nowhere."""

import struct
from functools import partial

import numpy as np
import pyproj
import pytest
import trimesh
from support import model_survey
from support.model_survey import DUTCH, FEET
from support.tileset import contents_of, geocentric, tiles_of

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.raising import extrude
from lidar_buildings.core.stages.building_model.result import BuildingModel
from lidar_buildings.io.models.survey_building import ModelHeading, TerrainMesh
from lidar_buildings.io.models.tiles3d import EarthFrame, NoPlaceError, tiles3d_folder

TERRAIN = TerrainMesh(
    "terrain", np.array([[0.0, 0, 1], [10, 0, 1], [10, 10, 2], [0, 10, 1]]), np.array([[0, 1, 2], [0, 2, 3]])
)


def hall():
    outline = Outline(model_survey.rectangle(300, 0, 420, 50))
    return outline, BuildingModel({"1.2": extrude(outline, 0.0, 9.0)}, {"lod": "1.2"})


def written(folder, frame=DUTCH, buildings=None, terrain=(), **options):
    """Write a survey, and return its buildings and the folder."""
    tiles = folder / "tiles3d"
    with model_survey.survey(folder, model_survey.shapes(frame, buildings), frame=frame) as survey:
        with tiles3d_folder(tiles, ModelHeading(earth=EarthFrame(frame, frame.crs, **options))) as add:
            for one in (*survey, *terrain):
                add(one)
        return list(survey), tiles


@pytest.fixture(scope="module")
def dutch(tmp_path_factory):
    buildings = model_survey.BUILDINGS | {11: hall}
    return written(tmp_path_factory.mktemp("tiles"), buildings=buildings, terrain=[TERRAIN])


def in_source(places, crs):
    """Turn geocentric coordinates into x, y of a reference system and ellipsoidal height."""
    around = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    longitude, latitude, height = around.transform(*places.T, direction="INVERSE")
    plan = pyproj.Transformer.from_crs(crs, "EPSG:4979", always_xy=True)
    return np.column_stack([*plan.transform(longitude, latitude, direction="INVERSE"), height])


@pytest.mark.parametrize("frame", [DUTCH, FEET])
def test_vertices_lie_where_those_of_the_solids_do(tmp_path, frame):
    buildings, folder = written(tmp_path, frame)
    found = np.concatenate([geocentric(*content) for content in contents_of(folder)])
    found = np.unique(np.round(in_source(found, frame.crs) * [*frame.units[:2], 1.0], 3), axis=0)
    expected = np.concatenate([frame.to_source(b.solid.vertices) for b in buildings if b.solid]) * frame.units
    distances = np.abs(found[:, None] - expected).max(axis=2)
    assert distances.min(axis=0).max() < 2e-3, "each vertex of a solid is there"
    assert distances.min(axis=1).max() < 2e-3, "and none that is not of a solid"


def test_files_are_closed_meshes_that_another_reader_reads(dutch):
    buildings, folder = dutch
    volume = 0.0
    for path in folder.glob("*.glb"):
        meshes = [one for one in trimesh.load_scene(path).geometry.values() if len(one.faces) > 2]
        for mesh in meshes:
            mesh.merge_vertices(merge_norm=True, merge_tex=True)
            assert mesh.is_watertight
            volume += mesh.volume
    # the Dutch grid is 6e-5 smaller there than the earth, in both directions
    assert volume == pytest.approx(sum(b.solid.volume for b in buildings if b.solid) * 1.00012, rel=2e-5)


def test_normals_are_units_that_look_out_of_their_triangles_and_surfaces_have_their_colours(dutch):
    for file, _ in contents_of(dutch[1]):
        a, b, c = file.attribute("POSITION").reshape(-1, 3, 3).swapaxes(0, 1)
        normals = file.attribute("NORMAL")
        assert (normals**2).sum(axis=1) == pytest.approx(np.ones(len(normals)), abs=1e-5)
        assert ((np.cross(b - a, c - a) * normals[::3]).sum(axis=1) > 0).all()
    for file, _ in contents_of(dutch[1]):
        colours, normals = file.attribute("COLOR_0")[:, :3], file.attribute("NORMAL")
        up = normals[:, 1]
        kinds = [colours[chosen] for chosen in (up > 0.1, np.abs(up) < 0.1, up < -0.1)]
        assert len(np.unique(np.concatenate([np.unique(kind, axis=0) for kind in kinds]), axis=0)) == 3
        assert [len(np.unique(kind, axis=0)) for kind in kinds] == [1, 1, 1]


def test_each_building_is_there_once_with_its_attributes(dutch):
    buildings, folder = dutch
    rows = {}
    for file, _ in contents_of(folder):
        ids = file.attribute("_FEATURE_ID_0").ravel().astype(int)
        names = ("readable_id", "building_id", "lod", "reason", "volume", "n_points")
        columns = [file.column(name) for name in names]
        assert sorted(set(ids)) == list(range(len(columns[0])))
        rows |= {row[0]: row[1:] for row in zip(*columns, strict=True)}
    expected = {
        b.readable_id: (b.building_id, b.attributes["lod"], None, b.attributes.get("volume"), None)
        for b in buildings
        if b.solid
    }
    assert rows == expected


def test_terrain_is_there_without_attributes(dutch):
    terrain = [
        file
        for file, _ in contents_of(dutch[1])
        if "extensions" not in file.json["meshes"][0]["primitives"][-1]
    ]
    assert [file.attribute("POSITION", -1).shape for file in terrain] == [(6, 3)]


def test_large_buildings_stand_above_small_ones_and_boxes_hold_what_is_below(dutch):
    tiles = list(tiles_of(dutch[1]))
    names = [tile["content"]["uri"] for tile, *_ in tiles if "content" in tile]
    assert names == ["3_0_0.glb", "0_0_0.glb"], "a hall of 130 m, and houses"
    matrices = {id(tile): matrix for tile, matrix, _ in tiles}
    for tile, matrix, parent in tiles[1:]:
        assert tile["geometricError"] < parent["geometricError"]
        assert_within(tile, matrix, parent, matrices[id(parent)])


def far_apart(n_rows):
    """Return houses in squares of their own, with a hall among them."""
    places = {number: divmod(number, n_rows) for number in range(1, n_rows**2)}

    def house(column, row):
        west, south = 300.0 * column, 300.0 * row
        outline = Outline(model_survey.rectangle(west, south, west + 10.0, south + 8.0))
        return outline, BuildingModel({"1.2": extrude(outline, 0.0, 5.0)}, {"lod": "1.2"})

    return {number: partial(house, *place) for number, place in places.items()} | {500: hall}


def test_tiles_lie_within_those_above_them_and_have_smaller_errors(tmp_path):
    folder = written(tmp_path, buildings=far_apart(6))[1]
    tiles = list(tiles_of(folder))
    assert len(tiles) > 20
    matrices = {id(tile): matrix for tile, matrix, _ in tiles}
    for tile, matrix, parent in tiles[1:]:
        assert tile["geometricError"] < parent["geometricError"]
        assert_within(tile, matrix, parent, matrices[id(parent)])


def assert_within(tile, matrix, parent, above):
    """A tile's box lies in that of the tile above it."""
    to_parent = np.linalg.inv(above) @ matrix
    box, outer = (np.reshape(one["boundingVolume"]["box"], (4, 3)) for one in (tile, parent))
    centre = (to_parent @ [*box[0], 1.0])[:3]
    assert (np.abs(centre - outer[0]) + np.diag(box[1:]) <= np.diag(outer[1:]) + 1e-6).all()


def test_equal_surveys_give_equal_bytes(dutch, tmp_path):
    _, folder = written(tmp_path, buildings=model_survey.BUILDINGS | {11: hall}, terrain=[TERRAIN])
    files = {path.name: path.read_bytes() for path in dutch[1].iterdir()}
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == files


def test_a_survey_without_buildings_gives_a_tileset_without_content(tmp_path):
    _, folder = written(tmp_path, buildings={})
    ((tile, _, _),) = tiles_of(folder)
    assert "content" not in tile


def test_the_height_of_the_geoid_is_added_where_there_is_no_grid(tmp_path):
    crs = "EPSG:7415"
    points = np.array([[10.0, 20.0, 5.0]])
    low, high = EarthFrame(DUTCH, crs), EarthFrame(DUTCH, crs, 43.5)
    step = high.matrix[:3, 3] - low.matrix[:3, 3]
    assert np.linalg.norm(step) == pytest.approx(43.5, abs=1e-6)
    assert high.local(points) == pytest.approx(low.local(points), abs=1e-3)
    assert "+ 43.5 m" in high.heights


def test_a_vertical_grid_gives_ellipsoidal_heights(tmp_path):
    grid = tmp_path / "geoid.gtx"
    heights = np.full((3, 3), 40.0, ">f4")
    grid.write_bytes(struct.pack(">4d2i", 51.0, 3.0, 1.0, 1.0, 3, 3) + heights.tobytes())
    frame = MapFrame("EPSG:32631", (600000.0, 5760000.0, 0.0))
    crs = f"+proj=utm +zone=31 +datum=WGS84 +units=m +geoidgrids={grid} +vunits=m"
    earth = EarthFrame(frame, crs, 7.0)
    assert earth.has_grid
    assert earth.heights.startswith("ellipsoidal")
    assert in_source(earth.matrix[:3, 3][None], frame.crs)[0] == pytest.approx([6e5, 5.76e6, 40.0], abs=1e-3)
    given = EarthFrame(frame, frame.crs, 7.0, str(grid))
    assert in_source(given.matrix[:3, 3][None], frame.crs)[0][2] == pytest.approx(40.0, abs=1e-3)
    assert not given.lacks_geoid
    assert EarthFrame(frame, frame.crs).lacks_geoid


@pytest.mark.parametrize(("crs", "why"), [("", "no reference system"), ('LOCAL_CS["site"]', ".")])
def test_a_survey_that_lies_nowhere_is_refused_with_the_reason(crs, why):
    with pytest.raises(NoPlaceError, match=why):
        EarthFrame(MapFrame(crs), crs)
