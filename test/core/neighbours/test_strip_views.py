"""From where strips were seen, told by the pattern of their points."""

from __future__ import annotations

import numpy as np
import pytest
from support.street_points import seen_from_above, seen_from_street

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.neighbours.strip_views import (
    count_cells,
    joined_counts,
    strip_numbers,
    strip_views,
    views_of_counts,
    with_covered,
)


@pytest.mark.parametrize("density", [0.5, 8.0, 60.0])
def test_an_even_strip_was_seen_from_above_whatever_its_density(density: float) -> None:
    points = seen_from_above(density)

    assert (strip_views(points, np.zeros(len(points), np.int64)) == View.ABOVE).all()


def test_points_that_get_fewer_away_from_a_track_were_seen_from_the_street() -> None:
    points = seen_from_street()

    assert (strip_views(points, np.zeros(len(points), np.int64)) == View.STREET).all()


def test_a_clip_full_of_walls_as_dense_as_nothing_from_the_air_is_of_the_street() -> None:
    draw = np.random.default_rng(0)
    x, z = draw.uniform(0.0, 40.0, 100_000), draw.uniform(0.0, 8.0, 100_000)
    wall = np.column_stack([x, 0.02 * draw.standard_normal(len(x)) + 1.0, z])

    assert (strip_views(wall, np.zeros(len(wall), np.int64)) == View.STREET).all()


def test_strips_of_one_number_are_told_apart_by_the_hour() -> None:
    air, street = seen_from_above(), seen_from_street()
    time = np.concatenate([np.full(len(air), 100.0), np.full(len(street), 90_000.0)])
    points = np.concatenate([air, street])

    view = strip_views(points, strip_numbers(np.ones(len(points), np.uint16), time, len(points)))

    assert (view[: len(air)] == View.ABOVE).all()
    assert (view[len(air) :] == View.STREET).all()


def test_a_strip_of_few_points_is_as_most_others() -> None:
    street, few = seen_from_street(), seen_from_above()[:50]
    strip = np.repeat([1, 2], [len(street), len(few)])

    assert (strip_views(np.concatenate([street, few]), strip) == View.STREET).all()


def test_counts_of_parts_tell_the_same_as_those_of_the_whole() -> None:
    points, strip = seen_from_street(), np.ones(40_000, np.int64)
    whole = count_cells(points, strip, step=3)

    parts = joined_counts([count_cells(points[k::2], strip[k::2], step=3) for k in range(2)])

    np.testing.assert_array_equal(parts, whole)
    assert views_of_counts(whole) == {1: View.STREET}
    assert views_of_counts(whole[:0]) == {}


def test_points_from_the_street_are_covered_where_there_are_some_from_above() -> None:
    points = np.array([[0.0, 0.0, 9.0], [1.0, 0.0, 0.0], [30.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    view = np.array([View.ABOVE, View.STREET, View.COVERED, View.UNKNOWN], dtype=np.uint8)

    found = with_covered(points, view, 0.3)

    np.testing.assert_array_equal(found, [View.ABOVE, View.COVERED, View.STREET, View.UNKNOWN])
    alone = with_covered(points, np.full(4, View.STREET, np.uint8), 0.3)
    np.testing.assert_array_equal(alone, np.full(4, View.STREET))
