"""The tiles of a live survey on the writer's disk: later revisions, resuming, beginning anew."""

from dataclasses import replace

import pytest
from std_msgs.msg import Header
from support.cloud_files import random_cloud
from support.node_bench import (
    FRAME,
    HOUSE,
    SHED,
    STAMP,
    call,
    done,
    fragments,
    send_tile,
    told,
    wait_until,
    warnings,
)
from support.results import building_ids
from support.saved_tiles import load_products

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.nodes.map_frames import origin_message
from lidar_buildings.ros.qos import LATCHED
from lidar_buildings.ros.stamps import header_of, to_stamp

pytestmark = pytest.mark.graph

NEXT = STAMP + 1_000_000_000
#: Tells a run from others by what its results depend on.
OTHER_SETTINGS = {"settings": '{"regularisation": {"max_offset": 2.0}}'}


# revisions


def test_a_later_revision_replaces_the_earlier_one_on_disk(live, tmp_path):
    _, other = live
    for stamp, building in ((STAMP, HOUSE), (STAMP + 1, SHED), (STAMP + 4, HOUSE)):
        send_tile(other, building, stamp=stamp)
        wait_until(lambda stamp=stamp: stamp in done(other))
        (fragment,) = fragments(tmp_path)
        products = load_products(fragment)
        assert products.stamp == stamp
        assert [one.building_id for one in products.outlines] == [building]
    assert done(other) == [STAMP, STAMP + 1, STAMP + 4]


def test_a_revision_that_is_on_disk_or_earlier_is_answered_with_what_is_there(live, tmp_path):
    _, other = live
    send_tile(other, HOUSE, stamp=STAMP + 2)
    wait_until(lambda: done(other) == [STAMP + 2])
    first = fragments(tmp_path)[0].stat().st_mtime_ns
    send_tile(other, HOUSE, stamp=STAMP + 2)
    send_tile(other, SHED, stamp=STAMP)
    wait_until(lambda: len(done(other)) == 3)
    assert set(done(other)) == {STAMP + 2}
    assert fragments(tmp_path)[0].stat().st_mtime_ns == first


def test_a_later_revision_waits_for_its_own_models(live):
    _, other = live
    send_tile(other, HOUSE, without=("outlines",))  # never completes
    send_tile(other, HOUSE, stamp=STAMP + 1, without=("city_model",))
    send_tile(other, SHED, stamp=NEXT)  # comes after all that
    wait_until(lambda: done(other) == [NEXT])
    send_tile(other, HOUSE, stamp=STAMP + 1)
    wait_until(lambda: done(other) == [NEXT, STAMP + 1])


def test_a_later_revision_that_was_given_up_is_told_of_though_the_earlier_one_is_there(live, tmp_path):
    writer, other = live
    send_tile(other, HOUSE)
    wait_until(lambda: done(other))
    writer.on_failed(header_of(STAMP))
    assert writer.failed_tiles == {}
    writer.on_failed(header_of(STAMP + 1))
    assert writer.failed_tiles.keys() == {STAMP}
    send_tile(other, HOUSE, stamp=STAMP + 2)
    wait_until(lambda: len(done(other)) == 2)
    assert writer.failed_tiles == {}


# resuming and resetting


def test_a_writer_that_was_killed_goes_on_with_its_tiles_and_its_earlier_files(
    bench, make_live_writer, live, tmp_path
):
    _, other = live
    send_tile(other, HOUSE, stamp=STAMP + 3)
    wait_until(lambda: done(other))
    call(other, "save")
    again = bench(make_live_writer(), "", "tile_done diagnostics")  # as after a kill: nothing was closed
    wait_until(lambda: done(again) == [STAMP + 3, STAMP + 3])
    assert building_ids(tmp_path / "out") == [HOUSE]


def test_a_live_survey_of_other_parameters_is_not_taken_up(make_live_writer, live, tmp_path):
    _, other = live
    send_tile(other, HOUSE)
    wait_until(lambda: done(other))
    for given in (OTHER_SETTINGS, {"raster_resolution": 1.0}):
        writer = make_live_writer(**given)
        writer.on_frame(FRAME)
        with pytest.raises(OutputError, match="unfinished run with other inputs or parameters"):
            writer.outcome.result()
        writer.destroy_node()
    assert len(fragments(tmp_path)) == 1


def test_files_of_another_run_are_not_written_over(make_live_writer, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "run.json").write_text("{}")
    with pytest.raises(OutputError, match="finished run"):
        make_live_writer()


def test_a_reset_forgets_the_tiles_but_not_the_files(bench, make_live_writer, live, tmp_path):
    _, other = live
    send_tile(other, HOUSE, stamp=STAMP + 3)
    wait_until(lambda: done(other))
    call(other, "save")
    answer = call(other, "reset")
    other.told.clear()  # as the source does
    assert (answer.success, answer.message) == (True, "1 tiles are forgotten")
    assert fragments(tmp_path) == []
    assert building_ids(tmp_path / "out") == [HOUSE]
    other.heard["tile_done"].clear()
    wait_until(lambda: other.count_publishers("tile_done") == 1)
    send_tile(other, SHED)  # the first revision again
    wait_until(lambda: done(other) == [STAMP])
    late = []
    other.create_subscription(Header, "tile_done", late.append, LATCHED)
    wait_until(lambda: late)
    call(other, "save")
    assert building_ids(tmp_path / "out") == [SHED]
    assert [to_stamp(message.stamp) for message in late] == [STAMP]


def test_another_frame_is_taken_only_where_no_tile_is_on_disk(live, tmp_path):
    _, other = live
    moved = replace(FRAME, origin=(85100.0, 447000.0, 0.0))
    other.send("map_origin", origin_message(moved))
    send_tile(other, HOUSE)
    wait_until(lambda: done(other))
    other.send("map_origin", origin_message(FRAME))
    wait_until(lambda: warnings(other))
    assert "keep the frame of the tiles on disk" in warnings(other)[0]
    call(other, "save")
    assert told(tmp_path)["frame"]["origin"] == list(moved.origin)
    call(other, "reset")
    other.told.clear()
    send_tile(other, HOUSE)
    wait_until(lambda: len(fragments(tmp_path)) == 1)
    call(other, "save")
    assert told(tmp_path)["frame"]["origin"] == list(FRAME.origin)


def test_a_writer_of_files_neither_saves_nor_resets(bench, make_live_writer, tmp_path):
    random_cloud(73).write(tmp_path / "cloud.laz")
    other = bench(make_live_writer(input=[str(tmp_path / "cloud.laz")]), "", "tile_done diagnostics")
    assert [call(other, service).success for service in ("save", "reset")] == [False, False]
