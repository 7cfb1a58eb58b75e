"""The node that makes tiles of a feed, as others see it."""

from contextlib import ExitStack
from types import SimpleNamespace

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from support.node_bench import Bench, call, made, running, wait_until

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.nodes import scan_assembler
from lidar_buildings.nodes.configs import ScanAssemblerConfig
from lidar_buildings.nodes.map_frames import origin_message
from lidar_buildings.nodes.scan_assembler import ScanAssembler
from lidar_buildings.ros.point_cloud import cloud_message, from_message
from lidar_buildings.ros.qos import CLOUD
from lidar_buildings.ros.stamps import tile_of, to_stamp

pytestmark = pytest.mark.graph

T0 = 1_700_000_000_000_000_000


class End(Bench):
    """A graph that has every tile done at once, unless it is told to hold them."""

    def __init__(self, sends, **kwargs):
        super().__init__(f"{sends} fix tile_done", "map_origin survey_done", **kwargs)
        self.heard["points"] = []
        self.to["scan"] = self.create_publisher(PointCloud2, "scan", 100)
        self.create_subscription(PointCloud2, "points", self.on_points, CLOUD)

    def on_points(self, message):
        self.heard["points"].append(message)
        self.to["tile_done"].publish(message.header)

    def flush(self, n=1):
        """Have all points made into tiles, for the n-th time."""
        assert call(self, "flush", "scan_assembler").success
        wait_until(lambda: len(self.heard["survey_done"]) == n)

    def send_scans(self, *scans):
        """Send scans, and wait until they have come: a service may be faster."""
        before = self.assembler.tiles.counts()["scans"]
        self.send("scan", *scans)
        wait_until(lambda: self.assembler.tiles.counts()["scans"] == before + len(scans))

    def tiles(self):
        return [from_message(message).tile for message in self.heard["points"]]


@pytest.fixture
def start(context):
    """Start an assembler and what is at both its ends."""

    def make(sends="", **parameters):
        values = {"tile_size": 40.0, "buffer": 5.0, "leave_after": 3600.0} | parameters
        values["qos_overrides./scan.subscription.reliability"] = "reliable"
        end = End(sends, context=context)
        end.assembler = made(ScanAssembler, context, **values)
        started.enter_context(running(end, end.assembler))
        wait_until(lambda: end.to["scan"].get_subscription_count() and end.count_publishers("points"))
        return end

    with ExitStack() as started:
        yield make


def scan(number, n_points=300, at=(20.0, 20.0)):
    rows = np.zeros(n_points, [(axis, "<f4") for axis in "xyz"])
    random = np.random.default_rng(number)
    rows["x"], rows["y"] = (random.uniform(c - 5, c + 5, n_points) for c in at)
    return cloud_message(T0 + number * 1_000_000, rows.reshape(1, -1))


def test_a_flush_sends_what_there_is_and_then_says_that_the_survey_is_done(start):
    end = start()
    end.send_scans(scan(0), scan(1, at=(100.0, 20.0)))
    end.flush()
    assert sorted(len(tile) for tile in end.tiles()) == [300, 300]
    wait_until(lambda: end.heard["map_origin"])
    assert [origin.header.frame_id for origin in end.heard["map_origin"]] == [""]


def test_scans_that_are_lost_on_the_way_are_told_of(start):
    assembler = start().assembler
    assembler.on_lost(SimpleNamespace(total_count=3))
    _, message, values = assembler.summary.state()
    assert values["scans_lost"] == 3
    assert "3 scans were lost" in message


def test_that_no_scan_has_come_is_told_once(start, monkeypatch):
    monkeypatch.setattr(scan_assembler, "_PATIENCE", 0.0)
    said = []
    monkeypatch.setattr(ScanAssembler, "warn", lambda _, text: said.append(text))
    end = start()
    wait_until(lambda: said)
    end.send_scans(scan(0))
    assert said == ["so far no scan has arrived on /scan"]


def test_of_scans_of_a_bag_that_is_played_to_it_no_such_thing_is_told(start, monkeypatch):
    said = []
    monkeypatch.setattr(ScanAssembler, "warn", lambda _, text: said.append(text))
    assembler = start().assembler
    assembler.tiles.add_scan(scan(0))
    monkeypatch.setattr(scan_assembler, "_PATIENCE", 0.0)
    wait_until(lambda: assembler._has_looked)
    assert said == []


def test_more_points_make_a_later_revision(start):
    end = start()
    end.send_scans(scan(0))
    end.flush()
    end.send_scans(scan(1))
    end.flush(2)
    first, second = (to_stamp(message.header.stamp) for message in end.heard["points"])
    assert (first % 1000, second % 1000) == (0, 1)
    assert tile_of(second) == first
    assert [len(tile) for tile in end.tiles()] == [300, 600]


def test_while_paused_scans_are_gathered_and_no_tile_is_sent(start):
    end = start(leave_after=0.0)
    call(end, "pause", "scan_assembler")
    end.send_scans(scan(0), scan(1, at=(100.0, 20.0)))
    call(end, "step", "scan_assembler")
    wait_until(lambda: end.heard["points"])
    assert len(end.heard["points"]) == 1
    call(end, "resume", "scan_assembler")
    wait_until(lambda: sum(map(len, end.tiles())) >= 600)


def test_reset_forgets_points_and_tiles(start):
    end = start()
    end.send_scans(scan(0))
    end.flush()
    assert call(end, "reset", "scan_assembler").success
    wait_until(lambda: end.assembler.tiles.counts()["scans"] == 0)
    end.send_scans(scan(1, 200))
    end.flush(2)
    assert [len(tile) for tile in end.tiles()] == [300, 200]


def test_where_others_say_the_map_lies_is_taken_and_told_on(start):
    end = start("map_origin")
    frame = MapFrame("EPSG:25832", (460_000.0, 5_930_000.0, 3.0))
    end.send("map_origin", origin_message(frame))
    wait_until(lambda: end.heard["map_origin"] and end.assembler.tiles._search._found)
    end.send_scans(scan(0))
    wait_until(lambda: len(end.heard["map_origin"]) == 2)
    assert {one.header.frame_id for one in end.heard["map_origin"]} == {"EPSG:25832"}


def test_given_parameters_say_where_the_map_lies(start):
    end = start(map_crs="EPSG:28992", map_position="85000, 447000, 0")
    end.send_scans(scan(0))
    wait_until(lambda: end.heard["map_origin"])
    (origin,) = end.heard["map_origin"]
    assert (origin.header.frame_id, origin.point.x, origin.point.y) == ("EPSG:28992", 85_000.0, 447_000.0)


@pytest.mark.parametrize(
    ("crs", "place"),
    [("EPSG:28992", ""), ("map", "0, 0, 0"), ("EPSG:4326", "5, 52, 0"), ("", "0, 0"), ("", "0, nan, 0")],
)
def test_parameters_that_say_no_place_are_refused(crs, place):
    with pytest.raises(ParameterError, match=r"scan_assembler\.map_"):
        ScanAssemblerConfig(map_crs=crs, map_position=place)


def test_a_spool_keeps_the_points_and_they_become_files(start, tmp_path):
    end = start(spool=str(tmp_path / "feed"))
    end.send_scans(scan(0))
    end.flush()
    log = tmp_path / "feed" / "points.log"
    assert log.stat().st_size > 0
    assert len(list((tmp_path / "feed" / "clouds").glob("points_*.laz"))) == 1
