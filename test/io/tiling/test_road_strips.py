"""Strips of a vehicle's way: each point beside it is of one of them, soon after it was passed."""

from itertools import pairwise

import numpy as np
import pytest

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.tiling import road_strips
from lidar_buildings.io.tiling.road_strips import BESIDE, BEYOND, CONTEXT, RoadStrips
from lidar_buildings.io.tiling.spool import RECORD


def seen_at(xy, time=1.0):
    records = np.zeros(len(xy), RECORD)
    records["x"], records["y"] = np.transpose(xy)
    records["view"], records["gps_time"] = View.STREET, time
    return records


def drive(strips, way):
    """Drive along places, 5 m on each side of which something is seen when the vehicle is there."""
    taken = []
    for k, (place, after) in enumerate(pairwise(way)):
        along = (after - place) / np.hypot(*(after - place))
        aside = np.array([-along[1], along[0]])
        strips.add(
            seen_at([place + 5.0 * aside, place - 5.0 * aside], 1000.0 + k), np.append(place, 2.0)[None]
        )
        while strips.ready:
            taken.append((k, strips.ready.popleft()))
    return taken


def straight(length):
    return np.column_stack([np.arange(0.0, length, 1.0), np.zeros(int(length))])


@pytest.fixture
def strips():
    return RoadStrips(8.0, MapFrame())


def test_a_strip_comes_with_its_context_when_the_vehicle_is_far_enough_beyond(strips):
    taken = drive(strips, straight(60))
    assert [k for k, _ in taken] == [8 + BEYOND, 16 + BEYOND, 24 + BEYOND, 32 + BEYOND, 40 + BEYOND]
    _, second = taken[1]
    core, rest = second.points[second.is_core], second.points[~second.is_core]
    assert (core[:, 0].min(), core[:, 0].max()) == (8.0, 15.0)
    assert (rest[:, 0].min(), rest[:, 0].max()) == (0.0, 16.0 + CONTEXT - 1.0)
    assert second.is_from_street.all()


def test_each_point_beside_a_winding_way_is_of_one_strip_and_its_end_of_the_last(strips):
    t = np.arange(0.0, 150.0)
    way = np.column_stack([t, 20.0 * np.sin(t / 25.0)])
    taken = drive(strips, way)
    strips.end()
    core = np.concatenate([one.points[one.is_core] for _, one in taken] + [strips.ready[0].points])
    own = {tuple(np.round(one, 3)) for one in core.tolist()}
    assert len(own) == 2 * 149
    assert sum(one.is_core.sum() for _, one in taken) + strips.ready[0].is_core.sum() == 2 * 149


def test_what_lies_far_aside_is_left_out_and_a_jump_ends_the_way(strips):
    strips.add(seen_at([(0.0, 3.0), (0.0, BESIDE + CONTEXT + 5.0)]), np.zeros((1, 3)))
    strips.add(seen_at([(500.0, 3.0)]), np.array([[500.0, 0.0, 2.0]]))
    (only,) = strips.ready
    np.testing.assert_array_equal(only.points, [[0.0, 3.0, 0.0]])


def test_of_a_vehicle_that_stands_nothing_is_ready_and_of_strips_nobody_takes_the_last_are_kept(strips):
    for _ in range(50):
        strips.add(seen_at([(0.0, 3.0)]), np.zeros((1, 3)))
    assert not strips.ready
    for place in straight(100):
        strips.add(seen_at([place + 3.0]), np.append(place, 0.0)[None])
    assert (len(strips.ready), strips.n_skipped) == (4, 6)


def test_a_vehicle_that_stands_keeps_the_latest_points_and_no_more_than_there_is_room_for(
    strips, monkeypatch
):
    monkeypatch.setattr(road_strips, "_MOST_POINTS", 10)
    for k in range(30):
        strips.add(seen_at([(k, 3.0)]), np.zeros((1, 3)))
    strips.end()
    assert strips.ready[0].points[:, 0].tolist() == list(range(20, 30))


def test_without_a_length_there_are_none():
    assert drive(RoadStrips(0.0, MapFrame()), straight(60)) == []
