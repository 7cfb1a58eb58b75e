"""The files of a live survey: made as often as one likes, while tiles go on coming."""

from dataclasses import replace

import laspy
import pytest
from support.cloud_files import random_cloud
from support.node_bench import (
    FRAME,
    HOUSE,
    SHED,
    STAMP,
    call,
    done,
    fragments,
    roof,
    send_tile,
    told,
    wait_until,
    warnings,
)
from support.results import building_ids

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.nodes.map_frames import origin_message
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.stamps import header_of

pytestmark = pytest.mark.graph


def test_tiles_wait_for_the_map_frame(live_bench, make_live_writer, tmp_path):
    other = live_bench(make_live_writer())
    send_tile(other, HOUSE)
    assert not call(other, "save").success
    assert done(other) == []
    other.send("map_origin", origin_message(FRAME))
    wait_until(lambda: done(other) == [STAMP])
    assert call(other, "save").success
    assert told(tmp_path)["frame"]["origin"] == list(FRAME.origin)


def test_files_are_made_as_often_as_asked_while_tiles_stay(live, tmp_path):
    _, other = live
    send_tile(other, HOUSE)
    wait_until(lambda: done(other))
    answer = call(other, "save")
    assert answer.success
    assert answer.message == f"1 tiles, 1 buildings are written to {tmp_path / 'out'}"
    assert building_ids(tmp_path / "out") == [HOUSE]
    send_tile(other, SHED, stamp=STAMP + 1)
    wait_until(lambda: len(done(other)) == 2)
    assert call(other, "save").success
    assert building_ids(tmp_path / "out") == [SHED]
    assert len(fragments(tmp_path)) == 1
    assert not list((tmp_path / "out").glob(".partial/features*"))


def test_at_the_end_of_the_survey_files_are_made_and_the_writer_goes_on(live, tmp_path):
    writer, other = live
    for n, ids in enumerate([(HOUSE,), (HOUSE, SHED)], start=1):
        send_tile(other, *ids, stamp=STAMP + n)
        wait_until(lambda n=n: STAMP + n in done(other))
        other.send("survey_done", header_of(STAMP))
        wait_until(lambda n=n: told(tmp_path).get("buildings") == {"ok": n})
        assert not writer.outcome.done()


def test_a_survey_that_ended_before_the_frame_was_known_has_its_files(live_bench, make_live_writer, tmp_path):
    other = live_bench(make_live_writer())
    other.send("survey_done", header_of(STAMP))
    send_tile(other, HOUSE)
    other.send("map_origin", origin_message(FRAME))
    wait_until((tmp_path / "out" / "run.json").exists)


def test_files_that_cannot_be_made_do_not_end_the_writer(live, tmp_path, monkeypatch):
    writer, other = live

    def fail(*_, **__):
        raise OutputError("out: cannot be written (disk full): free some space")

    with monkeypatch.context() as full:
        full.setattr("lidar_buildings.nodes.survey_folder.OutputFolder.finalise", fail)
        answer = call(other, "save")
        other.send("survey_done", header_of(STAMP))
        wait_until(lambda: warnings(other))
    assert (answer.success, answer.message) == (False, "out: cannot be written (disk full): free some space")
    assert "disk full" in warnings(other)[0]
    assert call(other, "save").success
    assert not writer.outcome.done()


def test_classified_clouds_are_made_of_what_the_source_has_written(live, tmp_path):
    _, other = live
    send_tile(other, HOUSE)
    wait_until(lambda: done(other))
    call(other, "save")
    (problem,) = told(tmp_path)["problems"]
    assert (
        problem == f"no classified clouds: the source's clouds are not on this host "
        f"({tmp_path / 'placed'}/points_*.laz)"
    )
    assert told(tmp_path)["inputs"] == []
    assert not (tmp_path / "out" / "classified").exists()
    (tmp_path / "placed").mkdir()
    for number, n_points in enumerate([30, 12]):  # not all rows are written yet
        cloud = random_cloud(n_points)
        cloud.withheld = [0] * n_points  # else they keep their class
        cloud.write(tmp_path / "placed" / f"points_{number:05}.laz")
    (tmp_path / "placed" / "points_00002.laz").write_bytes(b"LASF")
    call(other, "save")
    (problem,) = told(tmp_path)["problems"]
    assert "points_00002.laz" in problem
    written = laspy.read(tmp_path / "out" / "classified" / "points_00000.laz")
    assert set(written.classification) == {6}
    assert list(written.BuildingId) == [0] + [HOUSE] * 29
    assert (told(tmp_path)["n_points"], told(tmp_path)["n_unclassified"]) == (42, 12)
    (tmp_path / "placed" / "points_00001.laz").unlink()
    (tmp_path / "placed" / "points_00002.laz").unlink()
    call(other, "save")
    assert [one.name for one in (tmp_path / "out" / "classified").iterdir()] == ["points_00000.laz"]


def test_points_of_somebody_else_that_name_no_rows_give_models_and_rasters(live, tmp_path):
    _, other = live
    nameless = replace(roof(HOUSE), source=None, index=None)
    for topic in ("classified_points", "plane_points"):
        other.send(topic, to_message(nameless))
    send_tile(other, HOUSE, without=("classified_points", "plane_points"))
    wait_until(lambda: done(other))
    assert call(other, "save").success
    assert building_ids(tmp_path / "out") == [HOUSE]
    assert (tmp_path / "out" / "dsm.tif").exists()
