"""What is left of a feed when it ends: what `run` makes of its points."""

import json

import pytest
from support.cli_runs import Command

from lidar_buildings.simulation.live.airborne import MOUNTING

pytestmark = pytest.mark.graph

SMALL = ("--scene", "courtyards", "--density", "2", "--pulse-rate", "30000")
#: Tiles of the feed; those of a run are larger.
TILES = ("--set", "scan_assembler.tile_size=50", "--set", f"scan_assembler.mounting={MOUNTING}")
FILES = ("--set", 'model_writer.formats=["gpkg", "cityjson"]')


def models(output):
    """The city model, but for the name of the files that it is made of, and the layers."""
    header, *lines = (output / "city_model.city.jsonl").read_bytes().splitlines()
    told = json.loads(header)
    del told["metadata"]["title"]
    return told, lines, (output / "buildings.gpkg").read_bytes()


def test_a_feed_ends_with_the_bytes_that_a_run_makes_of_its_strips(capfd, tmp_path):
    command = Command(capfd)
    bag, strips, live = tmp_path / "bag", tmp_path / "strips", tmp_path / "live"
    assert command("simulate", *SMALL, "--bag", bag, "--output", strips, "--no-tf").status == 0
    assert command("live", "--replay", bag, "--rate", "0", "--output", live, *TILES, *FILES).status == 0
    assert command("run", strips, "--no-ros", "--output", tmp_path / "run", *FILES).status == 0
    told, lines, layers = models(live)
    assert (told, lines, layers) == models(tmp_path / "run")
    assert len(lines) > 4
    n_tiles = json.loads((live / "run.json").read_text())["n_tiles"]
    assert len(list((live / ".partial").glob("*.npz"))) > n_tiles  # the live ones were others
