"""Given footprints through the node graph: the same files as without ROS."""

import json

import pytest
import shapely
from support.cli_runs import Command
from support.results import contents
from support.vector_files import write_geopackage

from lidar_buildings.io.vectors.layers import VectorLayer, read_polygons
from lidar_buildings.simulation import simulate_survey

pytestmark = pytest.mark.graph

#: Cuts the house's survey into nine tiles, whose buffer has to grow for the house.
SMALL_TILES = ["--tile-size", "25", "--set", "tile_player.buffer=2"]


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """One house with its footprint, and a footprint on open ground."""
    folder = tmp_path_factory.mktemp("house")
    simulate_survey(folder, "single_house", 0, density=3.0)
    (outline,), _, crs = read_polygons(folder / "truth.gpkg", "outlines")
    west, south, _, _ = outline.bounds
    polygons = [outline, shapely.box(west - 12, south - 12, west - 8, south - 9)]
    rows = [{"name": "house"}, {"name": "no building"}]
    layer = VectorLayer("given", polygons, {"name": str}, rows)
    write_geopackage(folder / "given.gpkg", [layer], crs)
    return folder


def test_footprints_give_the_same_files_as_without_ros(survey, tmp_path, capfd):
    command = Command(capfd, *SMALL_TILES, "--footprint-id", "name")
    arguments = ["run", survey / "strip_01.laz", "--footprints", survey / "given.gpkg", "--output"]
    for folder, *more in ((tmp_path / "graph",), (tmp_path / "plain", "--no-ros")):
        spoken = command(*arguments, folder, *more)
        assert (spoken.status, spoken.err) == (0, [])
        assert "footprints: 2 read" in spoken.out
        assert sum(json.loads((folder / "run.json").read_text())["buildings"].values()) == 2
    assert contents(tmp_path / "graph") == contents(tmp_path / "plain")
