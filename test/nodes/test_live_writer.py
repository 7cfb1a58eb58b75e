"""The files of a live survey: made as often as one likes, while tiles go on coming."""

from dataclasses import replace

import laspy
import pytest
from support import node_bench
from support.cloud_files import random_cloud
from support.results import building_ids

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.nodes.map_frames import origin_message
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.stamps import header_of

pytestmark = pytest.mark.graph


def test_tiles_wait_for_the_map_frame(live_bench, make_live_writer, tmp_path):
    other = live_bench(make_live_writer())
    node_bench.send_tile(other, node_bench.HOUSE)
    assert not node_bench.call(other, "save").success
    assert node_bench.done(other) == []
    other.send("map_origin", origin_message(node_bench.FRAME))
    node_bench.wait_until(lambda: node_bench.done(other) == [node_bench.STAMP])
    assert node_bench.call(other, "save").success
    assert node_bench.told(tmp_path)["frame"]["origin"] == list(node_bench.FRAME.origin)


def test_files_are_made_as_often_as_asked_while_tiles_stay(live, tmp_path):
    _, other = live
    node_bench.send_tile(other, node_bench.HOUSE)
    node_bench.wait_until(lambda: node_bench.done(other))
    answer = node_bench.call(other, "save")
    assert answer.success
    assert answer.message == f"written to {tmp_path / 'out'}: 1 tile, 1 building"
    assert building_ids(tmp_path / "out") == [node_bench.HOUSE]
    node_bench.send_tile(other, node_bench.SHED, stamp=node_bench.STAMP + 1)
    node_bench.wait_until(lambda: len(node_bench.done(other)) == 2)
    assert node_bench.call(other, "save").success
    assert building_ids(tmp_path / "out") == [node_bench.SHED]
    assert len(node_bench.fragments(tmp_path)) == 1
    assert not list((tmp_path / "out").glob(".partial/features*"))


def test_what_is_said_of_the_files_counts_tiles_that_failed(live, tmp_path):
    _, other = live
    node_bench.send_tile(other, node_bench.HOUSE)
    node_bench.wait_until(lambda: node_bench.done(other))
    other.send("tile_failed", header_of(node_bench.STAMP + 1_000_000_000))
    node_bench.wait_until(lambda: "; 1 tile failed, see" in node_bench.call(other, "save").message)
    assert len(node_bench.told(tmp_path)["failed_tiles"]) == 1


def test_at_the_end_of_the_survey_files_are_made_and_the_writer_goes_on(live, tmp_path):
    writer, other = live
    for n, ids in enumerate([(node_bench.HOUSE,), (node_bench.HOUSE, node_bench.SHED)], start=1):
        node_bench.send_tile(other, *ids, stamp=node_bench.STAMP + n)
        node_bench.wait_until(lambda n=n: node_bench.STAMP + n in node_bench.done(other))
        other.send("survey_done", header_of(node_bench.STAMP))
        node_bench.wait_until(lambda n=n: node_bench.told(tmp_path).get("buildings") == {"ok": n})
        assert not writer.outcome.done()


def test_a_survey_that_ended_before_the_frame_was_known_has_its_files(live_bench, make_live_writer, tmp_path):
    other = live_bench(make_live_writer())
    other.send("survey_done", header_of(node_bench.STAMP))
    node_bench.send_tile(other, node_bench.HOUSE)
    other.send("map_origin", origin_message(node_bench.FRAME))
    node_bench.wait_until((tmp_path / "out" / "run.json").exists)


def test_files_that_cannot_be_made_do_not_end_the_writer(live, tmp_path, monkeypatch):
    writer, other = live

    def fail(*_, **__):
        raise OutputError("out: cannot be written (disk full): free some space")

    with monkeypatch.context() as full:
        full.setattr("lidar_buildings.io.results.survey_folder.OutputFolder.finalise", fail)
        answer = node_bench.call(other, "save")
        other.send("survey_done", header_of(node_bench.STAMP))
        node_bench.wait_until(lambda: node_bench.warnings(other))
    assert (answer.success, answer.message) == (False, "out: cannot be written (disk full): free some space")
    assert "disk full" in node_bench.warnings(other)[0]
    assert node_bench.call(other, "save").success
    assert not writer.outcome.done()


def test_classified_clouds_are_made_of_what_the_source_has_written(live, tmp_path):
    _, other = live
    node_bench.send_tile(other, node_bench.HOUSE)
    node_bench.wait_until(lambda: node_bench.done(other))
    node_bench.call(other, "save")
    (problem,) = node_bench.told(tmp_path)["problems"]
    assert (
        problem == f"no classified clouds: the source's clouds are not on this host "
        f"({tmp_path / 'placed'}/points_*.laz)"
    )
    assert node_bench.told(tmp_path)["inputs"] == []
    assert not (tmp_path / "out" / "classified").exists()
    (tmp_path / "placed").mkdir()
    for number, n_points in enumerate([30, 12]):  # not all rows are written yet
        cloud = random_cloud(n_points)
        cloud.withheld = [0] * n_points  # else they keep their class
        cloud.write(tmp_path / "placed" / f"points_{number:05}.laz")
    (tmp_path / "placed" / "points_00002.laz").write_bytes(b"LASF")
    node_bench.call(other, "save")
    (problem,) = node_bench.told(tmp_path)["problems"]
    assert "points_00002.laz" in problem
    written = laspy.read(tmp_path / "out" / "classified" / "points_00000.laz")
    assert set(written.classification) == {6}
    assert list(written.BuildingId) == [0] + [node_bench.HOUSE] * 29
    assert (node_bench.told(tmp_path)["n_points"], node_bench.told(tmp_path)["n_unclassified"]) == (42, 12)
    (tmp_path / "placed" / "points_00001.laz").unlink()
    (tmp_path / "placed" / "points_00002.laz").unlink()
    node_bench.call(other, "save")
    assert [one.name for one in (tmp_path / "out" / "classified").iterdir()] == ["points_00000.laz"]


def test_points_of_somebody_else_that_name_no_rows_give_models_and_rasters(live, tmp_path):
    _, other = live
    nameless = replace(node_bench.roof(node_bench.HOUSE), source=None, index=None)
    for topic in ("classified_points", "plane_points"):
        other.send(topic, to_message(nameless))
    node_bench.send_tile(other, node_bench.HOUSE, without=("classified_points", "plane_points"))
    node_bench.wait_until(lambda: node_bench.done(other))
    assert node_bench.call(other, "save").success
    assert building_ids(tmp_path / "out") == [node_bench.HOUSE]
    assert (tmp_path / "out" / "dsm.tif").exists()
