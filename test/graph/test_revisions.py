"""A tile comes again with a house gone and another new: all that listens and the files follow."""

import json

import numpy as np
import pytest
from support.lawn import houses_on_a_lawn
from support.node_bench import STAMP, Bench, call, running, wait_until
from support.results import assert_buildings_once, building_features, building_ids
from visualization_msgs.msg import Marker

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.nodes.graph import make_node
from lidar_buildings.nodes.map_frames import origin_message
from lidar_buildings.nodes.table import nodes_until
from lidar_buildings.ros.point_cloud import to_message
from lidar_buildings.ros.stamps import to_stamp

pytestmark = pytest.mark.graph

#: West, south, east and north of the houses.
FIRST, SECOND, THIRD = (4, 6, 14, 16), (20, 6, 32, 16), (40, 6, 52, 16)


@pytest.fixture
def graph(context, tmp_path):
    """A live graph without a source, in one process; and what is at both its ends."""
    settings = {"model_writer": {"output": str(tmp_path / "out")}}
    names = nodes_until("building_model")[1:]
    ends = Bench("points map_origin", "tile_done outlines city_model building_markers", context=context)
    with running(ends, *(make_node(name, settings, context=context) for name in names)):
        wait_until(lambda: ends.count_subscribers("points") and all(map(ends.count_publishers, ends.heard)))
        yield ends


def send(ends, revision, *houses):
    points, _ = houses_on_a_lawn(houses=houses, elevations=[7.0] * len(houses), width=60.0)
    n = len(points)
    tile = PointTile(points, source=np.zeros(n), index=np.arange(n), stamp=STAMP + revision)
    ends.send("points", to_message(tile))
    wait_until(lambda: STAMP + revision in [to_stamp(one.stamp) for one in list(ends.heard["tile_done"])])


def outlined(ends, revision):
    """Ids of the buildings that have an outline in a revision, and of those that are withdrawn."""

    def told():
        heard = list(ends.heard["outlines"])
        return [m.polygon for m in heard if to_stamp(m.header.stamp) == STAMP + revision]

    wait_until(lambda: -1 in [one.id for one in told()])
    there, gone = ({one.id for one in told() if bool(one.polygon.points) is has} for has in (True, False))
    return there, gone - {-1}


def modelled(ends):
    """Names of the features that are there when all has been heard."""
    names = {}
    for message in list(ends.heard["city_model"]):
        line = json.loads(message.data)
        if line["type"] == "CityJSONFeature":
            names[line["id"]] = bool(line["CityObjects"])
    return {name for name, is_there in names.items() if is_there}


def shown(ends):
    """Ids of the markers that are there when all has been heard."""
    actions = {m.id: m.action for array in list(ends.heard["building_markers"]) for m in array.markers}
    return {number % 2**32 for number, action in actions.items() if action == Marker.ADD}


def saved(ends, tmp_path):
    """Ids and names of the buildings in the files, which are made now."""
    answer = call(ends, "save")
    assert answer.success, answer.message
    assert_buildings_once(tmp_path / "out")
    names = {one["id"] for one in building_features(tmp_path / "out")}
    return set(building_ids(tmp_path / "out")), names


def test_a_house_that_is_gone_is_withdrawn_and_a_new_one_is_there(graph, tmp_path):
    graph.send("map_origin", origin_message(MapFrame("EPSG:28992", (85000.0, 447000.0, 0.0))))
    send(graph, 0, FIRST, SECOND)
    before, gone = outlined(graph, 0)
    assert (len(before), gone) == (2, set())
    ids, names = saved(graph, tmp_path)
    assert ids == before
    wait_until(lambda: shown(graph) == before)
    wait_until(lambda: modelled(graph) == names)

    send(graph, 1, SECOND, THIRD)
    after, gone = outlined(graph, 1)
    assert len(after) == 2
    assert (gone, len(before & after)) == (before - after, 1)
    ids, names = saved(graph, tmp_path)
    assert ids == after
    wait_until(lambda: shown(graph) == after)
    wait_until(lambda: modelled(graph) == names)
    assert json.loads((tmp_path / "out" / "run.json").read_text())["n_tiles"] == 1
