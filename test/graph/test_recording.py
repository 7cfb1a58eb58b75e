"""A run that is recorded gives a bag from which the same buildings come."""

import json

import pyogrio
import pytest
from support.cli_runs import SMALL_TILES
from support.cloud_files import fill_the_disk

from lidar_buildings.io.bags.bag_summary import summarise_bag
from lidar_buildings.nodes.table import RECORDED

pytestmark = pytest.mark.graph


def buildings(folder):
    rows = {
        layer: pyogrio.raw.read(folder / "buildings.gpkg", layer=layer)
        for layer in ("outlines", "traced", "roof_faces")
    }
    features = (folder / "city_model.city.jsonl").read_text().splitlines()[1:]
    geometries = {layer: sorted(row[2].tolist()) for layer, row in rows.items()}
    return geometries, sorted(features)


def test_the_bag_of_a_run_gives_the_same_buildings(command, house, tmp_path):
    run = ("run", house, *SMALL_TILES, "--output", tmp_path / "first", "--record", tmp_path / "bag.mcap")
    spoken = command(*run)
    assert (spoken.status, spoken.err) == (0, [])
    assert spoken.out[-2].startswith(f"  {tmp_path / 'bag'}: ")
    topics = {one.name: one for one in summarise_bag(tmp_path / "bag").topics}
    assert topics.keys() == {f"/{name}" for name in RECORDED}
    n_tiles = json.loads((tmp_path / "first" / "run.json").read_text())["n_tiles"]
    assert topics["/points"].n_messages >= n_tiles > 1
    assert (
        command("run", tmp_path / "bag", *SMALL_TILES, "--no-ros", "--output", tmp_path / "again").status == 0
    )
    assert buildings(tmp_path / "first") == buildings(tmp_path / "again")
    assert buildings(tmp_path / "first")[1]


def test_a_full_disk_under_the_bag_leaves_the_run_alone(command, house, tmp_path, monkeypatch):
    fill_the_disk(monkeypatch, ".mcap", 1000)
    run = ("run", house, *SMALL_TILES, "--output", tmp_path / "out", "--record", tmp_path / "bag")
    spoken = command(*run, "--until", "ground_filter")
    assert spoken.status == 2
    assert spoken.err[0].startswith(
        f"lidar-buildings: {tmp_path / 'bag'}: can no longer be written (No space"
    )
    assert " of /points" in spoken.err[0]
    assert (tmp_path / "out" / "run.json").exists()


def test_a_recording_that_cannot_be_made_is_refused_before_anything_is_touched(command, house, tmp_path):
    (tmp_path / "bag").mkdir()
    run = ("run", house, "--output", tmp_path / "out", "--record")
    assert "already exists" in command.refused(*run, tmp_path / "bag")
    assert "remove --no-ros or --record" in command.refused(*run, tmp_path / "new", "--no-ros")
    assert not (tmp_path / "out").exists()
    assert not (tmp_path / "new").exists()
