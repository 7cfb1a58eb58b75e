"""What tracer, builder and writer do with tiles that come torn, twice, cut off or out of order."""

import json
import time
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from std_msgs.msg import String
from support.cloud_files import random_cloud
from support.node_bench import (
    HOUSE,
    OF_A_TILE,
    SHED,
    STAMP,
    TO_WRITER,
    done,
    fragments,
    made,
    outlines,
    roof,
    running,
    send_tile,
    wait_until,
)
from support.saved_tiles import load_products

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import OutlineQuality
from lidar_buildings.core.model.sides import NONE, Sides
from lidar_buildings.core.model.stage_table import STAGES
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.nodes import stage_nodes
from lidar_buildings.nodes.graph import survey_nodes
from lidar_buildings.nodes.map_frames import origin_message, units_message
from lidar_buildings.nodes.model_writer import ModelWriter
from lidar_buildings.nodes.stage_nodes import BuildingTracer, FacadeFinder, GroundFilter, ModelBuilder
from lidar_buildings.pipeline.tile_stages import FilteredTile
from lidar_buildings.pipeline.tile_tracing import TracedTile
from lidar_buildings.ros.node_state import state_of
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.polygons import outline_rings, ring_messages
from lidar_buildings.ros.qos import LATCHED
from lidar_buildings.ros.stamps import header_of, to_stamp
from lidar_buildings.ros.text_messages import facades_message, quality_message, tile_closing_message
from lidar_buildings.ros.tile_info import info_message

pytestmark = pytest.mark.graph


EAST = Sides(east=True)
#: A tile after the one of the test: once it is through, all that was sent before it has been read.
LATER, BARN = 2 * STAMP, 13


def info_of_tile(bounds):
    return info_message(replace(roof(HOUSE), stamp=STAMP, bounds=bounds))


def asked_for(other):
    """Tiles that nodes find too small, and on which sides, by the last state."""
    states = [state_of(message) for message in list(other.heard["node_state"])]
    tiles = [one.tiles for one in states if one.node != "bench"][-1:]
    return {stamp: at.missing for of in tiles for stamp, at in of.items() if "east" in at.missing}


# the ground filter


def test_the_ground_filter_publishes_the_terrain_on_request(context, bench):
    node = made(GroundFilter, context, publish_dtm=True, dtm_resolution=1.0)
    other = bench(node, "points", "dtm")
    xy = np.random.default_rng(0).uniform(0.0, 1.0, (6000, 2)) * [60.0, 40.0]
    hall = (np.abs(xy - [30.0, 20.0]) < [8.0, 6.0]).all(axis=1)
    points = np.column_stack([xy, 3.0 + 0.05 * xy[:, 0] + 9.0 * hall])
    core = xy[:, 0] < 50.0
    other.send("points", to_message(PointTile(points, buffer=~core, stamp=STAMP)))
    wait_until(lambda: other.heard["dtm"])
    (message,) = other.heard["dtm"]
    assert to_stamp(message.header.stamp) == STAMP
    assert message.header.frame_id == "map"
    # a gap as near to a neighbour's point as to a core point is both tiles'
    assert (message.height, message.width, message.is_dense) == (40, 51, False)
    assert [(one.name, one.datatype) for one in message.fields] == [(axis, 7) for axis in "xyz"]
    grid = np.frombuffer(message.data, dtype=[(axis, "<f4") for axis in "xyz"]).reshape(40, 51)[:, :50]
    assert (grid["x"][:, 0] == 0.5).all()
    assert (grid["y"][0] == 39.5).all(), "the northernmost row first"
    known = np.isfinite(grid["z"])
    assert known.mean() > 0.97
    np.testing.assert_allclose(grid["z"][known], 3.0 + 0.05 * grid["x"][known], atol=0.15)


@pytest.fixture
def filtering(monkeypatch):
    """A ground filter that asks for more of every tile, east of it."""
    monkeypatch.setattr(stage_nodes, "filter_ground", lambda tile, _: FilteredTile(tile, EAST))


def test_a_tile_that_cuts_a_wide_roof_off_waits_for_the_word_that_this_is_all(context, bench, filtering):
    other = bench(GroundFilter(context=context), "points tile_info", "ground_points node_state")
    other.send("tile_info", info_of_tile((0.0, 0.0, 9.0, 9.0)))
    other.send("points", to_message(roof(HOUSE)))
    wait_until(lambda: asked_for(other) == {STAMP: ("east",)})
    assert not other.heard["ground_points"]
    other.send("tile_info", info_of_tile((0.0, 0.0, np.inf, 9.0)))
    wait_until(lambda: other.heard["ground_points"])


def test_without_a_source_that_can_send_more_no_tile_waits(context, bench, filtering):
    other = bench(GroundFilter(context=context), "points", "ground_points")
    other.send("points", to_message(roof(HOUSE)))
    wait_until(lambda: other.heard["ground_points"])


# the façade finder


@pytest.mark.parametrize("topic", ["street_points", "road_points"])
def test_the_facade_finder_publishes_a_map_of_what_was_seen_from_the_street(context, bench, topic):
    other = bench(FacadeFinder(context=context), "street_points road_points outlines", "wall_map")
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0.1, 4.0, 0.2), np.arange(0.1, 2.0, 0.2)))
    flat = {"classification": np.full(len(x), 2), "view": np.full(len(x), View.STREET)}
    ground = PointTile(np.column_stack([x, y, 0.0 * x]), height_above_ground=0.0 * x, stamp=STAMP, **flat)
    other.send(topic, to_message(ground))
    other.send("outlines", *ring_messages(STAMP, {}))
    wait_until(lambda: other.heard["wall_map"])
    (grid,) = other.heard["wall_map"]
    assert (grid.info.width, grid.info.height, set(grid.data)) == (20, 10, {0})


# the tracer


@pytest.fixture
def tracer(context, bench):
    return bench(
        BuildingTracer(context=context), "edge_points tile_info", "building_points traced_outlines node_state"
    )


@pytest.fixture
def tracing(monkeypatch):
    """Tracing that calls a tile clipped as long as it has bounds."""
    seen = []

    def trace(tile, *_, pool):
        seen.append(tile.bounds)
        return TracedTile(tile, outlines(HOUSE), NONE if tile.bounds is None else EAST)

    monkeypatch.setattr(stage_nodes, "trace_or_close", trace)
    return seen


def test_a_clipped_tile_is_held_back_and_asked_for(tracing, tracer):
    tracer.send("tile_info", info_of_tile((0.0, 0.0, 9.0, 9.0)))
    tracer.send("edge_points", to_message(roof(HOUSE)))
    wait_until(lambda: asked_for(tracer) == {STAMP: ("east",)})
    assert tracing == [(0.0, 0.0, 9.0, 9.0)]
    assert not tracer.heard["building_points"]
    tracer.send("tile_info", info_of_tile(None))
    wait_until(lambda: [m.polygon.id for m in list(tracer.heard["traced_outlines"])] == [HOUSE, -1])
    wait_until(lambda: tracer.heard["building_points"])
    assert len(tracing) == 1, "not traced again"


def test_a_tile_waits_for_what_is_said_of_it_where_someone_says_it(tracing, tracer):
    tracer.send("edge_points", to_message(roof(HOUSE)))
    later = roof(HOUSE, stamp=LATER)
    tracer.send("tile_info", info_message(later))
    tracer.send("edge_points", to_message(later))
    wait_until(lambda: tracer.heard["building_points"])
    tracer.send("tile_info", info_of_tile(None))
    wait_until(lambda: len(tracer.heard["building_points"]) == 2)
    assert [to_stamp(one.header.stamp) for one in tracer.heard["building_points"]] == [LATER, STAMP]


# the builder


FOOT = 1200.0 / 3937.0  # the survey foot of the system
FRAME = MapFrame("EPSG:2229", (1000.0, 2000.0, 0.0), FOOT, FOOT)


def quality_of_outlines(*ids, stamp=STAMP):
    quality = OutlineQuality(0.125, 0.5, BuildingStatus.TRACED_OUTLINE, "too narrow")
    return quality_message(stamp, [replace(one, quality=quality) for one in outlines(*ids)])


@pytest.fixture
def builder(context, bench):
    node = made(ModelBuilder, context, **{"flow_control.publish_tile_done": True})
    return bench(
        node, "plane_points outlines outline_quality facade_records", "roof_faces tile_done city_model"
    )


def test_the_builder_waits_until_points_and_outlines_name_the_same_buildings(builder):
    builder.publisher_of("map_origin").publish(origin_message(FRAME))
    for stamp, outlined in ((STAMP, (SHED,)), (LATER, (HOUSE, SHED))):
        builder.send("plane_points", to_message(roof(HOUSE, SHED, stamp=stamp)))
        builder.send("outline_quality", quality_of_outlines(HOUSE, SHED, stamp=stamp))
        builder.send("facade_records", facades_message(stamp, ()))
        builder.send("outlines", *ring_messages(stamp, outline_rings(outlines(*outlined))))
    wait_until(lambda: builder.heard["tile_done"])
    assert done(builder) == [LATER]
    builder.send("outlines", *ring_messages(STAMP, outline_rings(outlines(HOUSE, SHED))))
    wait_until(lambda: done(builder) == [LATER, STAMP])
    wait_until(lambda: [m.polygon.id for m in builder.heard["roof_faces"]] == 2 * [HOUSE, SHED, -1])


def features_of(other):
    lines = [json.loads(message.data) for message in list(other.heard["city_model"])]
    return [line for line in lines if line["type"] == "CityJSONFeature"]


def test_features_wait_for_the_map_frame_and_the_header_for_late_listeners(builder):
    units = builder.publisher_of("map_units")
    builder.send("plane_points", to_message(roof(HOUSE)))
    builder.send("outline_quality", quality_of_outlines(HOUSE))
    builder.send("facade_records", facades_message(STAMP, ()))
    builder.send("outlines", *ring_messages(STAMP, outline_rings(outlines(HOUSE))))
    time.sleep(0.3)
    assert builder.heard["tile_done"] == []
    builder.publisher_of("map_origin").publish(origin_message(FRAME))
    time.sleep(0.3)
    assert builder.heard["tile_done"] == []
    units.publish(units_message(FRAME))
    # the header has a publisher of its own, and comes when it likes
    wait_until(lambda: builder.heard["tile_done"] and len(features_of(builder)) == 2)
    feature, end = features_of(builder)
    assert (end["id"], end["CityObjects"]) == (f"tile-{STAMP}", {})
    attributes = next(iter(feature["CityObjects"].values()))["attributes"]
    assert "too narrow" in attributes["reason"]
    assert attributes["outline_sigma"] == pytest.approx(0.125 / FOOT, abs=1e-3)
    late = []
    builder.create_subscription(String, "city_model", late.append, LATCHED)
    wait_until(lambda: late)
    header = json.loads(late[0].data)
    assert header["type"] == "CityJSON"
    assert header["transform"]["scale"] == pytest.approx([0.001 / FOOT] * 3)
    assert header["transform"]["translate"][:2] == pytest.approx([1000.0 / FOOT, 2000.0 / FOOT])


# the writer


@pytest.fixture
def make_writer(context, tmp_path):
    cloud = tmp_path / "cloud.laz"
    random_cloud(73).write(cloud)
    return partial(made, ModelWriter, context, input=[str(cloud)], output=str(tmp_path / "out"))


@pytest.mark.parametrize("missing", OF_A_TILE.split())
def test_a_tile_is_on_disk_only_when_every_topic_has_spoken(bench, make_writer, tmp_path, missing):
    other = bench(make_writer(), TO_WRITER, "tile_done")
    send_tile(other, HOUSE, SHED, without=(missing,))
    send_tile(other, BARN, stamp=LATER)
    wait_until(lambda: other.heard["tile_done"])
    (later,) = fragments(tmp_path)
    assert done(other) == [load_products(later).stamp] == [LATER]
    send_tile(other, HOUSE, SHED)
    wait_until(lambda: STAMP in done(other))
    (products,) = (load_products(one) for one in fragments(tmp_path) if one != later)
    assert products.stamp == STAMP
    assert [one.building_id for one in products.outlines] == [HOUSE, SHED]
    assert len(products.features) == 2
    assert len(products.core) == 73


def test_an_empty_tile_is_a_tile_like_any_other(bench, make_writer, tmp_path):
    other = bench(make_writer(), TO_WRITER, "tile_done")
    empty = PointTile(np.zeros((0, 3)), building_id=np.zeros(0), stamp=STAMP)
    for topic in ("classified_points", "plane_points"):
        other.send(topic, to_message(empty))
    for topic in ("traced_outlines", "outlines"):
        other.send(topic, *ring_messages(STAMP, outline_rings(())))
    other.send("facade_records", facades_message(STAMP, ()))
    other.send("city_model", tile_closing_message(STAMP))
    wait_until(lambda: [to_stamp(m.stamp) for m in other.heard["tile_done"]] == [STAMP])
    assert len(fragments(tmp_path)) == 1


def test_a_tile_on_disk_holds_its_rasters(bench, make_writer, tmp_path):
    other = bench(make_writer(), TO_WRITER, "tile_done")
    send_tile(other, HOUSE)
    wait_until(lambda: other.heard["tile_done"])
    rasters = load_products(fragments(tmp_path)[0]).rasters
    assert np.nanmax(rasters.dsm) == 8.0
    assert np.isnan(rasters.dtm).all(), "the tile is one roof, and no ground"


def test_a_restarted_writer_reports_what_is_on_disk_and_then_makes_the_files(bench, make_writer, tmp_path):
    other = bench(make_writer(), TO_WRITER, "tile_done")
    send_tile(other, HOUSE)
    wait_until(lambda: other.heard["tile_done"])
    writer = make_writer()
    again = bench(writer, "", "tile_done")
    wait_until(lambda: STAMP in [to_stamp(message.stamp) for message in again.heard["tile_done"]])
    writer.on_failed(header_of(1_000_000_000))
    writer.on_survey_done(header_of(STAMP))
    wait_until(writer.outcome.done)
    assert writer.outcome.result().n_tiles == 1
    assert writer.exit_status == 3
    told = json.loads((tmp_path / "out" / "run.json").read_text())
    assert [failed["tile"] for failed in told["failed_tiles"]] == [1_000_000_000]
    assert told["is_finished"] is False, "the failed tile may come yet"


# the whole graph


@pytest.mark.parametrize("until", ["ground_filter", "boundary_tracing", "regularisation", STAGES[-1]])
def test_a_run_may_end_with_an_earlier_stage(context, tmp_path, until):
    cloud = tmp_path / "cloud.laz"
    random_cloud(400, size=(40.0, 30.0, 3.0)).write(cloud)
    nodes = survey_nodes([str(cloud)], str(tmp_path / "out"), until=until, context=context)
    with running(*nodes.values()) as composition:
        assert composition.wait(nodes["model_writer"], timeout=300.0)
    summary = nodes["model_writer"].outcome.result()
    assert summary.n_points == sum(summary.classes.values()) == 400
    told = json.loads((tmp_path / "out" / "run.json").read_text())
    ran = [stage for stage in STAGES if stage in told["seconds"]]
    assert set(ran) == set(STAGES[: STAGES.index(until) + 1])
    assert told["parameters"].keys() >= set(ran)
