"""The writer of a live survey: tiles come again in later revisions, files are made as often as one likes."""

import json
from dataclasses import replace

import laspy
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped
from rclpy.parameter import Parameter
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from support.cloud_files import random_cloud
from support.node_bench import (
    HOUSE,
    SHED,
    STAMP,
    WRITER_HEARS,
    WRITER_SENDS,
    fragments,
    roof,
    send_tile,
    wait_until,
)
from support.results import building_ids

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.results.tile_products import TileProducts
from lidar_buildings.nodes.model_writer import ModelWriter
from lidar_buildings.ros.map_frames import origin_message
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.qos import EVENT, LATCHED
from lidar_buildings.ros.stamps import header_of, to_stamp

pytestmark = pytest.mark.graph

SENDS = WRITER_SENDS | {"map_origin": (PointStamped, LATCHED)}
HEARS = WRITER_HEARS | {"diagnostics": (DiagnosticArray, EVENT)}
NEXT = STAMP + 1_000_000_000
FRAME = MapFrame("EPSG:28992", (85000.0, 447000.0, 0.0))
#: Tells a run from others by what its results depend on.
OTHER_SETTINGS = {"settings": '{"regularisation": {"max_offset": 2.0}}'}


@pytest.fixture
def make_writer(context, tmp_path):
    def make(**given):
        values = {"output": str(tmp_path / "out"), "placed": str(tmp_path / "placed"), **given}
        return ModelWriter(
            context=context, parameter_overrides=[Parameter(k, value=v) for k, v in values.items()]
        )

    return make


@pytest.fixture
def live(bench, make_writer):
    """A writer that knows its frame, and what sends to it."""
    writer = make_writer()
    other = bench(writer, SENDS, HEARS)
    other.send("map_origin", origin_message(FRAME))
    return writer, other


def done(other):
    return [to_stamp(message.stamp) for message in other.heard["tile_done"]]


def call(other, service):
    client = other.create_client(Trigger, f"model_writer/{service}")
    wait_until(client.service_is_ready)
    answer = client.call_async(Trigger.Request())
    wait_until(answer.done)
    return answer.result()


def told(tmp_path):
    path = tmp_path / "out" / "run.json"
    return json.loads(path.read_text()) if path.exists() else {}


# revisions


def test_a_later_revision_replaces_the_earlier_one_on_disk(live, tmp_path):
    _, other = live
    for stamp, building in ((STAMP, HOUSE), (STAMP + 1, SHED), (STAMP + 4, HOUSE)):
        send_tile(other, building, stamp=stamp)
        wait_until(lambda stamp=stamp: stamp in done(other))
        (fragment,) = fragments(tmp_path)
        products = TileProducts.load(fragment)
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
    send_tile(other, HOUSE, without=("roof_faces",))  # never completes
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


# files


def test_tiles_wait_for_the_map_frame(bench, make_writer, tmp_path):
    other = bench(make_writer(), SENDS, HEARS)
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


def test_a_survey_that_ended_before_the_frame_was_known_has_its_files(bench, make_writer, tmp_path):
    other = bench(make_writer(), SENDS, HEARS)
    other.send("survey_done", header_of(STAMP))
    send_tile(other, HOUSE)
    other.send("map_origin", origin_message(FRAME))
    wait_until((tmp_path / "out" / "run.json").exists)


def test_files_that_cannot_be_made_do_not_end_the_writer(live, tmp_path, monkeypatch):
    writer, other = live

    def fail(*_):
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


def warnings(other):
    status = (one for message in list(other.heard["diagnostics"]) for one in message.status)
    return [one.message for one in status if one.level == DiagnosticStatus.WARN]


def test_classified_clouds_are_made_of_what_the_source_has_written(live, tmp_path):
    _, other = live
    send_tile(other, HOUSE)
    wait_until(lambda: done(other))
    call(other, "save")
    (problem,) = told(tmp_path)["problems"]
    assert (
        problem
        == f"no classified clouds: the source's clouds are not here ({tmp_path / 'placed'}/points_*.laz)"
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


# resuming and resetting


def test_a_writer_that_was_killed_goes_on_with_its_tiles_and_its_earlier_files(
    bench, make_writer, live, tmp_path
):
    _, other = live
    send_tile(other, HOUSE, stamp=STAMP + 3)
    wait_until(lambda: done(other))
    call(other, "save")
    again = bench(make_writer(), {}, HEARS)  # as after a kill: nothing was closed
    wait_until(lambda: done(again) == [STAMP + 3, STAMP + 3])
    assert building_ids(tmp_path / "out") == [HOUSE]


def test_a_live_survey_of_other_parameters_is_not_taken_up(make_writer, live, tmp_path):
    _, other = live
    send_tile(other, HOUSE)
    wait_until(lambda: done(other))
    for given in (OTHER_SETTINGS, {"raster_resolution": 1.0}):
        writer = make_writer(**given)
        writer.on_frame(FRAME)
        with pytest.raises(OutputError, match="unfinished run of other inputs or parameters"):
            writer.outcome.result()
        writer.destroy_node()
    assert len(fragments(tmp_path)) == 1


def test_files_of_another_run_are_not_written_over(make_writer, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "run.json").write_text("{}")
    with pytest.raises(OutputError, match="finished run"):
        make_writer()


def test_a_reset_forgets_the_tiles_but_not_the_files(bench, make_writer, live, tmp_path):
    _, other = live
    send_tile(other, HOUSE, stamp=STAMP + 3)
    wait_until(lambda: done(other))
    call(other, "save")
    answer = call(other, "reset")
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
    assert "stay in the frame of the tiles on disk" in warnings(other)[0]
    call(other, "save")
    assert told(tmp_path)["frame"]["origin"] == list(moved.origin)
    call(other, "reset")
    send_tile(other, HOUSE)
    wait_until(lambda: len(fragments(tmp_path)) == 1)
    call(other, "save")
    assert told(tmp_path)["frame"]["origin"] == list(FRAME.origin)


def test_a_writer_of_files_neither_saves_nor_resets(bench, make_writer, tmp_path):
    random_cloud(73).write(tmp_path / "cloud.laz")
    other = bench(make_writer(input=[str(tmp_path / "cloud.laz")]), {}, HEARS)
    assert [call(other, service).success for service in ("save", "reset")] == [False, False]
