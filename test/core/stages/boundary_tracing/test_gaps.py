"""The width of gaps between points, and rings that do not follow them."""

import numpy as np
import pytest
import shapely
from support.traced_rings import assert_sound

from lidar_buildings.core.stages.boundary_tracing.tracing import gap_spacing, trace_boundary

WIDTH, HEIGHT, SPACING = 16.0, 10.0, 0.25
ROOF = shapely.box(0.0, 0.0, WIDTH, HEIGHT)


def even(seed=0):
    """One point anywhere in each cell."""
    u, v = np.meshgrid(np.arange(0.0, WIDTH, SPACING), np.arange(0.0, HEIGHT, SPACING))
    return np.column_stack((u.ravel(), v.ravel())) + np.random.default_rng(seed).uniform(
        0.0, SPACING, (u.size, 2)
    )


def lines(angle, ratio, seed=0):
    """Half of all points, in scan lines that are `ratio` times as far apart as the points along them."""
    along = SPACING * np.sqrt(2.0 / ratio)
    reach = np.hypot(WIDTH, HEIGHT)
    u, v = np.meshgrid(np.arange(-reach, reach, along), np.arange(-reach, reach, along * ratio))
    xy = np.column_stack((u.ravel(), v.ravel()))
    xy += np.random.default_rng(seed).uniform(-0.2, 0.2, xy.shape) * along
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    xy = xy @ turn + np.array([WIDTH, HEIGHT]) / 2
    return xy[shapely.contains_xy(ROOF, *xy.T)]


def crossing(ratio):
    return np.concatenate([lines(1.4, ratio, 1), lines(2.0, ratio, 2)])


def test_gaps_of_even_points_are_no_wider_than_these_are_apart():
    assert gap_spacing(even(), ROOF, SPACING) == pytest.approx(SPACING, rel=0.05)


def test_scan_lines_far_apart_leave_wide_gaps():
    found = [gap_spacing(crossing(ratio), ROOF, SPACING) for ratio in (1.0, 2.0, 4.0, 8.0, 60.0)]
    assert found == sorted(found)
    assert found[0] == SPACING
    assert 1.3 * SPACING < found[2] < 1.6 * SPACING
    assert found[-1] == 2.0 * SPACING


def test_a_wet_patch_is_no_gap_between_points():
    points = even()
    dry = points[~shapely.contains_xy(shapely.box(3.0, 3.0, 6.0, 4.0), *points.T)]
    assert gap_spacing(dry, ROOF, SPACING) == pytest.approx(SPACING, rel=0.05)


def test_a_courtyard_is_no_gap():
    yard = shapely.box(4.0, 2.0, 12.0, 8.0)
    points = even()
    rim = points[~shapely.contains_xy(yard, *points.T)]
    assert gap_spacing(rim, ROOF - yard, SPACING) == pytest.approx(SPACING, rel=0.05)


def test_an_outline_without_area_leaves_the_spacing_as_it_is():
    assert gap_spacing(np.zeros((3, 2)), shapely.Polygon(), 0.3) == 0.3


def test_a_ring_does_not_dip_into_the_gaps_between_scan_lines():
    xy = crossing(8.0)
    points = np.column_stack((xy, np.zeros(len(xy))))
    traced = trace_boundary(points, point_spacing=SPACING)
    assert_sound(traced, points)
    ring = traced.outline.polygon
    assert ring.length < 1.05 * ROOF.length
    assert ring.area > 0.95 * ROOF.area
