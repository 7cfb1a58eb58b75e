"""The tiles of a live survey on the writer's disk: later revisions, resuming, beginning anew."""

from dataclasses import replace

import pytest
from std_msgs.msg import Header
from support import node_bench
from support.cloud_files import random_cloud
from support.results import building_ids
from support.saved_tiles import load_products

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.nodes.map_frames import origin_message
from lidar_buildings.ros.qos import LATCHED
from lidar_buildings.ros.stamps import header_of, to_stamp

pytestmark = pytest.mark.graph

NEXT = node_bench.STAMP + 1_000_000_000
#: Tells a run from others by what its results depend on.
OTHER_SETTINGS = {"settings": '{"regularisation": {"max_offset": 2.0}}'}


# revisions


def test_a_later_revision_replaces_the_earlier_one_on_disk(live, tmp_path):
    _, other = live
    for stamp, building in (
        (node_bench.STAMP, node_bench.HOUSE),
        (node_bench.STAMP + 1, node_bench.SHED),
        (node_bench.STAMP + 4, node_bench.HOUSE),
    ):
        node_bench.send_tile(other, building, stamp=stamp)
        node_bench.wait_until(lambda stamp=stamp: stamp in node_bench.done(other))
        (fragment,) = node_bench.fragments(tmp_path)
        products = load_products(fragment)
        assert products.stamp == stamp
        assert [one.building_id for one in products.outlines] == [building]
    assert node_bench.done(other) == [node_bench.STAMP, node_bench.STAMP + 1, node_bench.STAMP + 4]


def test_a_revision_that_is_on_disk_or_earlier_is_answered_with_what_is_there(live, tmp_path):
    _, other = live
    node_bench.send_tile(other, node_bench.HOUSE, stamp=node_bench.STAMP + 2)
    node_bench.wait_until(lambda: node_bench.done(other) == [node_bench.STAMP + 2])
    first = node_bench.fragments(tmp_path)[0].stat().st_mtime_ns
    node_bench.send_tile(other, node_bench.HOUSE, stamp=node_bench.STAMP + 2)
    node_bench.send_tile(other, node_bench.SHED, stamp=node_bench.STAMP)
    node_bench.wait_until(lambda: len(node_bench.done(other)) == 3)
    assert set(node_bench.done(other)) == {node_bench.STAMP + 2}
    assert node_bench.fragments(tmp_path)[0].stat().st_mtime_ns == first


def test_a_later_revision_waits_for_its_own_models(live):
    _, other = live
    node_bench.send_tile(other, node_bench.HOUSE, without=("outlines",))  # never completes
    node_bench.send_tile(other, node_bench.HOUSE, stamp=node_bench.STAMP + 1, without=("city_model",))
    node_bench.send_tile(other, node_bench.SHED, stamp=NEXT)  # comes after all that
    node_bench.wait_until(lambda: node_bench.done(other) == [NEXT])
    node_bench.send_tile(other, node_bench.HOUSE, stamp=node_bench.STAMP + 1)
    node_bench.wait_until(lambda: node_bench.STAMP + 1 in node_bench.done(other))


def test_a_later_revision_that_was_given_up_is_told_of_though_the_earlier_one_is_there(live, tmp_path):
    writer, other = live
    node_bench.send_tile(other, node_bench.HOUSE)
    node_bench.wait_until(lambda: node_bench.done(other))
    writer.on_failed(header_of(node_bench.STAMP))
    assert writer.failed_tiles == {}
    writer.on_failed(header_of(node_bench.STAMP + 1))
    assert writer.failed_tiles.keys() == {node_bench.STAMP}
    node_bench.send_tile(other, node_bench.HOUSE, stamp=node_bench.STAMP + 2)
    node_bench.wait_until(lambda: len(node_bench.done(other)) == 2)
    assert writer.failed_tiles == {}


# resuming and resetting


def test_a_writer_that_was_killed_goes_on_with_its_tiles_and_its_earlier_files(
    bench, make_live_writer, live, tmp_path
):
    _, other = live
    node_bench.send_tile(other, node_bench.HOUSE, stamp=node_bench.STAMP + 3)
    node_bench.wait_until(lambda: node_bench.done(other))
    node_bench.call(other, "save")
    again = bench(make_live_writer(), "", "tile_done diagnostics")  # as after a kill: nothing was closed
    node_bench.wait_until(lambda: node_bench.done(again) == [node_bench.STAMP + 3, node_bench.STAMP + 3])
    assert building_ids(tmp_path / "out") == [node_bench.HOUSE]


def test_a_live_survey_of_other_parameters_is_not_taken_up(make_live_writer, live, tmp_path):
    _, other = live
    node_bench.send_tile(other, node_bench.HOUSE)
    node_bench.wait_until(lambda: node_bench.done(other))
    for given in (OTHER_SETTINGS, {"raster_resolution": 1.0}):
        writer = make_live_writer(**given)
        writer.on_frame(node_bench.FRAME)
        with pytest.raises(OutputError, match="unfinished run with other inputs or parameters"):
            writer.outcome.result()
        writer.destroy_node()
    assert len(node_bench.fragments(tmp_path)) == 1


def test_files_of_another_run_are_not_written_over(make_live_writer, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "run.json").write_text("{}")
    with pytest.raises(OutputError, match="finished run"):
        make_live_writer()


def test_a_reset_forgets_the_tiles_but_not_the_files(bench, make_live_writer, live, tmp_path):
    _, other = live
    node_bench.send_tile(other, node_bench.HOUSE, stamp=node_bench.STAMP + 3)
    node_bench.wait_until(lambda: node_bench.done(other))
    node_bench.call(other, "save")
    answer = node_bench.call(other, "reset")
    other.told.clear()  # as the source does
    assert (answer.success, answer.message) == (True, "forgotten: 1 tile")
    assert node_bench.fragments(tmp_path) == []
    assert building_ids(tmp_path / "out") == [node_bench.HOUSE]
    other.heard["tile_done"].clear()
    node_bench.wait_until(lambda: other.count_publishers("tile_done") == 1)
    node_bench.send_tile(other, node_bench.SHED)  # the first revision again
    node_bench.wait_until(lambda: node_bench.done(other) == [node_bench.STAMP])
    late = []
    other.create_subscription(Header, "tile_done", late.append, LATCHED)
    node_bench.wait_until(lambda: late)
    node_bench.call(other, "save")
    assert building_ids(tmp_path / "out") == [node_bench.SHED]
    assert [to_stamp(message.stamp) for message in late] == [node_bench.STAMP]


def test_another_frame_is_taken_only_where_no_tile_is_on_disk(live, tmp_path):
    writer, other = live
    moved = replace(node_bench.FRAME, origin=(85100.0, 447000.0, 0.0))
    other.send("map_origin", origin_message(moved))
    node_bench.wait_until(lambda: writer._survey.frame == moved)
    node_bench.send_tile(other, node_bench.HOUSE)
    node_bench.wait_until(lambda: node_bench.done(other))
    other.send("map_origin", origin_message(node_bench.FRAME))
    node_bench.wait_until(lambda: node_bench.warnings(other))
    assert "keep the frame of the tiles on disk" in node_bench.warnings(other)[0]
    node_bench.call(other, "save")
    assert node_bench.told(tmp_path)["frame"]["origin"] == list(moved.origin)
    node_bench.call(other, "reset")
    other.told.clear()
    node_bench.send_tile(other, node_bench.HOUSE)
    node_bench.wait_until(lambda: len(node_bench.fragments(tmp_path)) == 1)
    node_bench.call(other, "save")
    assert node_bench.told(tmp_path)["frame"]["origin"] == list(node_bench.FRAME.origin)


def test_a_writer_of_files_neither_saves_nor_resets(bench, make_live_writer, tmp_path):
    random_cloud(73).write(tmp_path / "cloud.laz")
    other = bench(make_live_writer(input=[str(tmp_path / "cloud.laz")]), "", "tile_done diagnostics")
    assert [node_bench.call(other, service).success for service in ("save", "reset")] == [False, False]
