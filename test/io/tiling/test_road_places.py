"""Places beside a vehicle's way: each is ready when it was passed, and when nothing new is seen there."""

import numpy as np
import pytest

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.tiling import road_places
from lidar_buildings.io.tiling.road_places import BEYOND, CONTEXT, NEW_POINTS, QUIET, RoadPlaces
from lidar_buildings.io.tiling.spool import RECORD

SIDE, START = 16.0, 1000.0


@pytest.fixture
def places():
    return RoadPlaces(SIDE, MapFrame())


def wall_at(x, y, time, n=2 * NEW_POINTS):
    """Points up a wall of 1 m, and one on the ground."""
    records = np.zeros(n + 1, RECORD)
    records["x"], records["y"] = x + np.linspace(0.0, 0.5, n + 1), y
    records["z"] = np.append(0.0, np.linspace(1.0, 3.0, n))
    records["view"], records["gps_time"] = View.STREET, START + time
    return records


def look(places, time, x=0.0, wall=None):
    """Let the vehicle be at x on its way along y = 0, and return what is ready."""
    seen = wall_at(x, 100.0, time, n=1) if wall is None else wall
    places.add(seen, np.array([[x, 0.0, 2.0]]))
    taken = list(places.ready)
    places.ready.clear()
    return taken


def test_a_place_is_ready_when_nothing_new_is_seen_there_and_comes_once(places):
    assert look(places, 0.0, wall=wall_at(4.0, 4.0, 0.0)) == []
    assert look(places, QUIET - 0.1) == []
    (only,) = look(places, QUIET + 0.2)
    assert len(only.points) == 2 * NEW_POINTS + 1
    assert only.is_core.all()
    assert only.is_from_street.all()
    assert look(places, 5.0) == []


def test_a_place_is_ready_when_it_was_passed_though_more_is_seen_and_again_with_all_in_the_end(places):
    when = []
    for k in range(60):
        taken = look(places, 0.1 * k, x=float(k), wall=wall_at(4.0, 4.0, 0.1 * k))
        when += [k] * len(taken)
    assert len(when) == 1
    assert BEYOND <= when[0] <= BEYOND + 20.0
    places.end()
    assert len(places.ready) == 1
    assert len(places.ready[0].points) == 60 * (2 * NEW_POINTS + 1)


def test_places_side_by_side_come_together_and_with_what_is_near_as_context(places):
    for x in (4.0, SIDE + 4.0, 2 * SIDE + 0.5 * CONTEXT, 2 * SIDE + CONTEXT + 1.0):
        look(places, 0.0, wall=wall_at(x, 4.0, 0.0 if x < 2 * SIDE else 0.4))
    first, *others = look(places, 0.7)
    assert others == []
    core, rest = first.points[first.is_core], first.points[~first.is_core]
    assert core[:, 0].max() < 2 * SIDE <= rest[:, 0].min()
    assert len(core) == 2 * (2 * NEW_POINTS + 1)
    assert rest[:, 0].max() <= 2 * SIDE + CONTEXT
    assert [one.is_core.sum() for one in look(places, 2.0)] == [2 * (2 * NEW_POINTS + 1)]


def test_stamps_rise_and_of_what_nobody_takes_the_last_are_kept(places):
    for k in range(20):
        places.add(wall_at(4.0 + 3 * SIDE * k, 4.0, 0.0), np.zeros((1, 3)))
    places.end()
    stamps = [one.stamp for one in places.ready]
    assert (len(stamps), places.n_skipped) == (16, 4)
    assert stamps == sorted(set(stamps))


def test_ground_alone_and_far_places_are_never_ready(places):
    flat = wall_at(4.0, 4.0, 0.0)
    flat["z"] = 0.0
    assert look(places, 0.0, wall=flat) == []
    assert look(places, 5.0) == []
    look(places, 6.0, wall=wall_at(4.0, 4.0, 6.0))
    assert len(look(places, 6.3, x=1000.0)) == 1  # it was passed; now it is forgotten
    assert look(places, 8.0, x=1000.0, wall=wall_at(4.0, 4.0, 8.0)) == []
    assert look(places, 9.0, x=1000.0) == []


def test_no_more_points_are_kept_than_there_is_room_for(places, monkeypatch):
    monkeypatch.setattr(road_places, "_MOST_POINTS", 50)
    for k in range(4):
        look(places, 0.3 * k, wall=wall_at(4.0 + 2 * SIDE * k, 4.0, 0.3 * k))
    places.end()
    assert sum(map(len, places.ready)) <= 50


def test_without_a_side_there_are_none():
    places = RoadPlaces(0.0, MapFrame())
    assert look(places, 0.0, wall=wall_at(4.0, 4.0, 0.0)) == []
    assert look(places, 5.0) == []
