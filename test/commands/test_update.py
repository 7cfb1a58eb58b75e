"""A survey brought up to date, and failed tiles done again: what was done stays, what is new is right."""

import json
import shutil

import laspy
import numpy as np
import pyogrio
import pytest
import shapely
from support.results import contents

from lidar_buildings.commands import run_local
from lidar_buildings.simulation import simulate_survey

TILES = ("--no-ros", "--tile-size", "60", "--set", "tile_player.buffer=20")


@pytest.fixture(scope="module")
def roofs(tmp_path_factory):
    """A survey of fourteen roofs in four files, one beside the other."""
    folder = tmp_path_factory.mktemp("roofs")
    simulate_survey(folder / "whole", "roof_types", 0, density=2.0)
    cloud = laspy.read(folder / "whole" / "strip_01.laz")
    column = np.searchsorted(np.quantile(cloud.x, [0.25, 0.5, 0.75]), cloud.x)
    (folder / "files").mkdir()
    for number in range(4):
        part = laspy.LasData(cloud.header)
        part.points = cloud.points[column == number].copy()
        part.write(folder / "files" / f"part_{number}.laz")
    return folder / "files"


@pytest.fixture
def survey(roofs, tmp_path):
    return shutil.copytree(roofs, tmp_path / "survey")


def change(path, keep):
    """Leave points out of a file."""
    cloud = laspy.read(path)
    cloud.points = cloud.points[keep(cloud)]
    cloud.write(path)


def outlines_of(folder):
    _, _, shapes, columns = pyogrio.raw.read(folder / "buildings.gpkg", layer="outlines")
    meta = pyogrio.read_info(folder / "buildings.gpkg", layer="outlines")["fields"].tolist()
    return dict(zip(columns[meta.index("building_id")].tolist(), shapely.from_wkb(shapes), strict=True))


def n_of_before(spoken):
    (line,) = (line for line in spoken.out if line.endswith("unchanged"))
    same, _, total, *_ = line.split()
    return int(same), int(total)


@pytest.mark.slow
def test_only_tiles_with_other_points_are_done_and_the_files_are_those_of_doing_all(
    command, survey, tmp_path
):
    kept, new = tmp_path / "kept", tmp_path / "new"
    first = command("run", survey, "--update", kept, *TILES)
    assert first.status == 0, first.err
    n_tiles = n_of_before(first)[1]
    assert n_of_before(first)[0] == 0
    again = command("run", survey, "--update", kept, *TILES)
    assert n_of_before(again) == (n_tiles, n_tiles)
    house = outlines_of(kept)[max(outlines_of(kept))]
    gone = house.buffer(5.0).bounds
    for path in survey.iterdir():  # the house in the east is pulled down, and its ground not measured
        change(path, lambda c: ~((c.x > gone[0]) & (c.x < gone[2]) & (c.y > gone[1]) & (c.y < gone[3])))
    after = command("run", survey, "--update", kept, *TILES)
    assert after.status == 0, after.err
    assert 0 < n_of_before(after)[0] < n_tiles
    (new / ".partial").mkdir(parents=True)
    for name in ("identity.json", "survey.json"):  # what was learnt of the survey, and no tile
        shutil.copy(kept / ".partial" / name, new / ".partial")
    assert n_of_before(command("run", survey, "--update", new, *TILES))[0] == 0
    assert contents(kept) == contents(new)


@pytest.mark.slow
def test_a_building_keeps_its_id_when_its_westernmost_points_are_others(command, survey, tmp_path):
    kept, new = tmp_path / "kept", tmp_path / "new"
    assert command("run", survey, "--update", kept, *TILES).status == 0
    before = outlines_of(kept)
    number = max(before)
    west, south, _, north = before[number].bounds
    for path in survey.iterdir():  # a metre of it is missing in the west
        change(
            path, lambda c: ~((c.x > west - 0.5) & (c.x < west + 1.5) & (c.y > south - 1) & (c.y < north + 1))
        )
    assert command("run", survey, "--update", kept, *TILES).status == 0
    command("run", survey, "--output", new, *TILES)
    after = outlines_of(kept)
    assert number not in outlines_of(new)
    assert after.keys() == before.keys()
    assert after[number].intersection(before[number]).area > 0.5 * before[number].area
    lines = [json.loads(line) for line in (kept / "city_model.city.jsonl").read_text().splitlines()]
    objects = [one for line in lines if "id" in line for one in line["CityObjects"].items()]
    names = [name for name, one in objects if one["type"] == "Building"]
    assert len(names) == len(set(names)) == len(before)
    ids = np.concatenate([laspy.read(path)["BuildingId"] for path in (kept / "classified").iterdir()])
    assert set(ids[ids > 0].tolist()) == set(before)


def test_what_was_made_otherwise_is_not_brought_up_to_date(command, survey, tmp_path):
    kept = tmp_path / "kept"
    (kept / "mine").mkdir(parents=True)
    assert "contains no run" in command.refused("run", survey, "--update", kept, *TILES)
    (kept / "mine").rmdir()
    until = ("--until", "ground_filter")
    assert command("run", survey, "--update", kept, *TILES, *until).status == 0
    said = command.refused(
        "run", survey, "--update", kept, *TILES, *until, "--set", "ground_filter.method=none"
    )
    assert "--update: its run used other parameters: give the same, or --overwrite" in said
    assert "contains no run with failed tiles" in command.refused(
        "run", survey, "--output", tmp_path / "other", "--retry-failed", *TILES
    )


@pytest.mark.slow
def test_tiles_that_failed_are_done_again_and_the_others_are_not(command, survey, tmp_path, monkeypatch):
    out, new = tmp_path / "out", tmp_path / "new"
    arguments = ("run", survey, "--output", out, *TILES)
    do_tile, seen = run_local.do_tile, []

    def failing(work, *others):
        seen.append(work.tile.stamp)
        if len(seen) in (2, 5):
            raise MemoryError("a tile as large as a town")
        return do_tile(work, *others)

    monkeypatch.setattr(run_local, "do_tile", failing)
    spoken = command(*arguments)
    assert spoken.status == 3
    assert spoken.err[-1].endswith("repeat the command with --retry-failed")
    failed = {seen[1], seen[4]}
    seen.clear()
    monkeypatch.setattr(
        run_local, "do_tile", lambda *given: seen.append(given[0].tile.stamp) or do_tile(*given)
    )
    assert command(*arguments, "--retry-failed").status == 0
    assert set(seen) == failed
    command("run", survey, "--output", new, *TILES)
    assert contents(out) == contents(new)
