"""Inputs at URLs and parts of inputs: the files of a run are those of the same points here."""

import json
import shutil

import laspy
import pytest
from support import cloud_files
from support.range_server import serving

from bench.scale.kills import differing
from lidar_buildings.io.clouds.fetch import fetched
from lidar_buildings.io.clouds.las import open_cloud

# a client of the web leaves a thread behind, see conftest
pytestmark = pytest.mark.cluster


@pytest.fixture
def store(house, tmp_path):
    """A folder with a survey as COPC."""
    folder = tmp_path / "store"
    folder.mkdir()
    cloud_files.saved_copc(laspy.read(next(house.glob("*.laz"))), folder / "house.copc.laz")
    return folder


def test_a_run_of_bounds_at_a_url_makes_the_files_of_one_here(store, tmp_path, command):
    cloud = open_cloud(store / "house.copc.laz")
    (west, south), (east, north) = cloud.mins[:2].round(), cloud.maxs[:2].round()
    how = ["--no-ros", "--until", "ground_filter", "--bounds", west, south, (west + east) / 2, north]
    assert command("run", store / "house.copc.laz", "--output", tmp_path / "here", *how).status == 0
    with serving(store) as address:
        inputs = [f"{address}/house.copc.laz", "--output", tmp_path / "there"]
        assert command("run", *inputs, *how).status == 0
    assert differing(tmp_path / "here", tmp_path / "there") == []
    made = json.loads((tmp_path / "there" / "run.json").read_text())
    assert list(made["fetched"].values()) == [f"{address}/house.copc.laz"]
    assert 0 < made["n_points"] < cloud.point_count
    assert made["files"][0] == "classified/house.laz"


def test_bounds_without_points_and_wrong_ones_are_refused(store, tmp_path, command):
    run = ["run", store / "house.copc.laz", "--output", tmp_path / "out", "--no-ros", "--bounds"]
    assert "no input has points in -9 -9 -8 -8" in command.refused(*run, -9, -9, -8, -8)
    assert "in 1 5930000.25 2 5930001: check" in command.refused(*run, 1, 5930000.25, 2, 5930001)
    assert "--bounds 5 5930000.25 3 1: must be WEST SOUTH" in command.refused(*run, 5, 5930000.25, 3, 1)


def test_plan_and_inspect_read_urls_and_plan_counts_bounds(store, command):
    with serving(store) as address:
        url = f"{address}/house.copc.laz"
        told = json.loads("\n".join(command("inspect", url, "--json").out))
        whole = json.loads("\n".join(command("plan", url, "--json").out))
    cloud = open_cloud(store / "house.copc.laz")
    (west, south), (east, north) = cloud.mins[:2], cloud.maxs[:2]
    bounds = ["--bounds", west, south, (west + east) / 2, north]
    half = json.loads("\n".join(command("plan", store / "house.copc.laz", "--json", *bounds).out))
    assert told[0]["n_points"] == whole["points"] == cloud.point_count
    assert 0.4 * cloud.point_count < half["points"] < 0.6 * cloud.point_count


def test_files_are_fetched_once_and_again_when_they_have_changed(store, tmp_path):
    with serving(store) as address:
        inputs, folder = [f"{address}/house.copc.laz", f"{address}/none.laz"], tmp_path / "fetched"
        (first, missing) = fetched(inputs, folder, None)
        assert missing == inputs[1], "it is named again when it is opened"
        with open(first, "rb") as one, open(store / "house.copc.laz", "rb") as other:
            assert one.read() == other.read()
        shutil.copy(cloud_files.saved(cloud_files.random_cloud(), tmp_path / "a.laz"), first)
        assert fetched(inputs, folder, None)[first] == inputs[0]
        assert open_cloud(first).point_count == 500, "it was not fetched again"
        shutil.copy(tmp_path / "a.laz", store / "house.copc.laz")
        with open(store / "house.copc.laz", "ab") as file:
            file.write(b"more")
        fetched(inputs, folder, None)
        with open(first, "rb") as one:
            assert one.read().endswith(b"more")
