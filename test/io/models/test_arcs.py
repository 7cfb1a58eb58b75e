"""Arcs found in rings of chords, and what is no arc."""

import numpy as np
import pytest

from lidar_buildings.io.models.dxf import ring_arcs


def carried(ring):
    """A ring as messages carry it."""
    return np.asarray(ring, dtype=np.float32).astype(np.float64)


def arc(centre, radius, start_deg, end_deg, n_chords):
    angle = np.radians(np.linspace(start_deg, end_deg, n_chords + 1))
    return np.add(centre, radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def apse(place=(0.0, 0.0)):
    """A nave with a half-circle at its east end: rows 1 to 9 are the arc."""
    ends = [[-10.0, -5.0]], arc((0.0, 0.0), 5.0, -90.0, 90.0, 8), [[-10.0, 5.0]]
    return carried(np.vstack(ends) + place)


@pytest.mark.parametrize("place", [(0.0, 0.0), (812.3, -340.1), (6543.21, 7654.32)])
def test_a_half_circle_between_walls_is_one_arc(place):
    found = ring_arcs(apse(place))
    assert found.rows.tolist() == [0, 1, 9, 10]
    assert found.bulges == pytest.approx([0.0, 1.0, 0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize("first", range(11))
def test_it_does_not_matter_where_a_ring_begins(first):
    ring = apse()
    found = ring_arcs(np.roll(ring, -first, axis=0))
    corners = {tuple(v) for v in np.roll(ring, -first, axis=0)[found.rows]}
    assert corners == {tuple(v) for v in ring[[0, 1, 9, 10]]}
    assert sorted(found.bulges) == pytest.approx([0.0, 0.0, 0.0, 1.0], abs=1e-4)


def test_an_arc_that_bends_inwards_has_a_negative_bulge():
    ring = np.vstack([[[-10.0, -10.0], [10.0, -10.0], [10.0, 5.0]], arc((0.0, 5.0), 5.0, 0.0, -180.0, 8)])
    found = ring_arcs(carried(np.vstack([ring, [[-10.0, 5.0]]])))
    assert found.bulges.min() == pytest.approx(-1.0, abs=1e-4)
    assert np.count_nonzero(found.bulges) == 1
    backwards = ring_arcs(carried(np.vstack([ring, [[-10.0, 5.0]]]))[::-1])
    assert backwards.bulges.max() == pytest.approx(1.0, abs=1e-4)


def test_a_circle_is_two_arcs():
    found = ring_arcs(carried(arc((3.0, 4.0), 6.0, 10.0, 370.0, 20)[:-1]))
    assert found.rows.tolist() == [0, 10]
    assert found.bulges == pytest.approx([1.0, 1.0], abs=1e-4)


def test_three_quarters_of_a_circle_are_drawn_in_parts_of_at_most_a_half():
    ring = carried(np.vstack([arc((0.0, 0.0), 8.0, 45.0, 315.0, 12), [[20.0, -5.0], [20.0, 5.0]]]))
    found = ring_arcs(ring)
    swept = 4.0 * np.degrees(np.arctan(found.bulges))
    assert swept.sum() == pytest.approx(270.0, abs=0.01)
    assert swept.max() <= 180.0


def test_a_shallow_bend_of_two_chords_is_an_arc():
    ring = carried(np.vstack([arc((0.0, 0.0), 20.0, 80.0, 100.0, 2), [[-12.0, 0.0], [12.0, 0.0]]]))
    found = ring_arcs(ring)
    assert found.rows.tolist() == [0, 2, 3, 4]
    assert found.bulges[0] == pytest.approx(np.tan(np.radians(20.0) / 4.0), abs=1e-5)


@pytest.mark.parametrize(
    "ring",
    [
        np.zeros((0, 2)),
        np.zeros((2, 2)),
        [[0, 0], [4, 0], [4, 4], [0, 4]],
        [[0, 0], [1, 0], [2, 0], [3, 0], [3, 2], [0, 2]],
        arc((0.0, 0.0), 4.0, 0.0, 360.0, 8)[:-1],
        arc((0.0, 0.0), 4.0, 0.0, 360.0, 6)[:-1],
    ],
    ids=["empty", "two", "square", "wall in equal parts", "octagon", "hexagon"],
)
def test_what_has_corners_or_is_straight_stays_as_it_is(ring):
    ring = carried(ring)
    found = ring_arcs(ring)
    assert found.rows.tolist() == list(range(len(ring)))
    assert not found.bulges.any()


def test_chords_that_differ_by_centimetres_are_walls():
    ring = arc((0.0, 0.0), 10.0, 0.0, 360.0, 20)[:-1]
    moved = carried(ring + 0.02 * np.random.default_rng(1).standard_normal(ring.shape))
    assert not ring_arcs(moved).bulges.any()


def test_arcs_of_different_radii_are_told_apart():
    large, small = arc((0.0, 0.0), 10.0, 0.0, 90.0, 6), arc((0.0, 5.0), 5.0, 90.0, 180.0, 5)
    ring = carried(np.vstack([large, small[1:], [[-5.0, 0.0]]]))
    swept = 4.0 * np.degrees(np.arctan(ring_arcs(ring).bulges))
    assert sorted(swept[swept > 0]) == pytest.approx([90.0, 90.0], abs=0.01)
