import numpy as np
import pytest

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.ros.polygons import (
    RingCollector,
    outline_rings,
    outlines_of,
    ring_message,
    ring_messages,
)

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
HOLE = np.array([[4.0, 4.0], [4.0, 6.0], [6.0, 6.0], [6.0, 4.0]])
POINT = np.array([[3.0, 3.0], [3.0, 3.0], [3.0, 3.0]])
STAMP = 5_000_000_001

COURTYARD = BuildingOutline(2**32 - 1, Outline(SQUARE, (HOLE, HOLE + 0.5)))
PLAIN = BuildingOutline(7, Outline(SQUARE + 100.0))
OUTLINES = (PLAIN, COURTYARD)


def collected(messages):
    collector = RingCollector()
    closed = [tile for tile in map(collector.add, messages) if tile is not None]
    assert len(closed) == 1
    return closed[0]


def assert_same(found, expected):
    assert [one.building_id for one in found] == [one.building_id for one in expected]
    assert all(one.outline.same_as(other.outline) for one, other in zip(found, expected, strict=True))


def test_outlines_come_back_as_they_were_sent():
    closed = collected(ring_messages(STAMP, outline_rings(OUTLINES)))
    assert_same(outlines_of(closed), OUTLINES)


def test_rings_are_open_outer_first_and_the_tile_is_closed_by_minus_one():
    messages = list(ring_messages(STAMP, outline_rings((COURTYARD,))))
    assert [message.polygon.id for message in messages] == [2**32 - 1] * 3 + [-1]
    assert [len(message.polygon.polygon.points) for message in messages] == [4, 4, 4, 0]
    first = messages[0].polygon.polygon.points
    assert (first[0].x, first[0].y) != (first[-1].x, first[-1].y)
    assert {(message.header.stamp.sec, message.header.frame_id) for message in messages} == {(5, "map")}


def test_tiles_may_be_interleaved():
    collector = RingCollector()
    left, right = (list(ring_messages(stamp, outline_rings(OUTLINES))) for stamp in (1, 2))
    closed = [collector.add(m) for pair in zip(left, right, strict=True) for m in pair]
    assert [tile is not None for tile in closed] == [False] * 8 + [True] * 2
    assert_same(outlines_of(closed[-1]), OUTLINES)


def test_a_tile_that_was_closed_begins_anew_when_it_comes_again():
    collector = RingCollector()
    for _ in range(2):
        closed = [collector.add(message) for message in ring_messages(STAMP, outline_rings(OUTLINES))][-1]
        assert_same(outlines_of(closed), OUTLINES)


@pytest.mark.parametrize("n_before_restart", [1, 2, 3, 4])
def test_a_sender_that_was_restarted_in_mid_tile_leaves_no_trace(n_before_restart):
    messages = list(ring_messages(STAMP, outline_rings(OUTLINES)))
    assert_same(outlines_of(collected(messages[:n_before_restart] + messages)), OUTLINES)


def test_holes_whose_outer_ring_was_lost_make_no_building():
    messages = list(ring_messages(STAMP, outline_rings(OUTLINES)))
    assert [one.building_id for one in outlines_of(collected(messages[2:]))] == []


def test_a_ring_without_area_is_an_outline_too():
    degenerate = BuildingOutline(3, Outline(POINT))
    assert_same(outlines_of(collected(ring_messages(STAMP, outline_rings((degenerate,))))), (degenerate,))


def test_roof_faces_keep_their_heights_their_holes_and_their_building():
    lower = np.column_stack([SQUARE, np.full(4, 3.0)])
    upper = np.column_stack([SQUARE + 20.0, np.arange(4.0)])
    hole = np.column_stack([HOLE, np.full(4, 3.0)])
    rings = {8: (lower, hole, upper), 9: (lower,)}
    torn = list(ring_messages(STAMP, rings))[:3]
    found = collected([*torn, *ring_messages(STAMP, rings)])
    assert {number: len(of_building) for number, of_building in found.items()} == {8: 3, 9: 1}
    assert np.array_equal(found[8][1], hole)
    assert np.array_equal(found[8][2], upper)


def test_a_ring_without_a_vertex_is_none():
    rings = {1: (np.zeros((0, 3)),), 2: (np.zeros((0, 3)), np.array([[0, 0, 5], [1, 0, 5], [0, 1, 5.0]]))}
    (found,) = outlines_of(rings)
    assert (found.building_id, found.ground_elevation) == (2, 5.0)


def test_tiles_that_are_never_closed_take_no_memory_without_end():
    collector = RingCollector()
    for number in range(200):
        collector.add(ring_message(number, 1, np.zeros((3, 3))))
    assert len(collector._open) < 100


def test_a_building_that_is_withdrawn_comes_without_vertices_and_is_no_outline():
    rings = {4: (), 2**32 - 2: (), **outline_rings(OUTLINES)}
    messages = list(ring_messages(STAMP, rings))
    assert [m.polygon.id for m in messages if not m.polygon.polygon.points] == [4, 2**32 - 2, -1]
    closed = collected(messages)
    assert {number: len(of) for number, of in closed.items()} == {
        number: len(of) for number, of in rings.items()
    }
    assert_same(outlines_of(closed), OUTLINES)


def test_a_vertex_that_is_not_finite_is_refused():
    bad = np.column_stack([SQUARE, np.zeros(4)])
    bad[2, 1] = np.nan
    with pytest.raises(InputError, match=r"polygon 4 has the vertex .*nan.*not finite"):
        RingCollector().add(ring_message(STAMP, 4, bad))
