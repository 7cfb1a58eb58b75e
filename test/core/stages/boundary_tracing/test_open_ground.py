"""Ground that was seen keeps rings from going round it."""

import numpy as np
import pytest
import shapely
from scipy.spatial import cKDTree
from support.traced_rings import assert_sound, polygon

from lidar_buildings.core.stages.boundary_tracing.closed_walls import GROUND_CELL
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.boundary_tracing.tracing import trace_boundary

SPACING = 1.5
YARD = shapely.box(0.0, 0.0, 24.0, 28.0) - shapely.box(8.0, 8.0, 15.0, 20.0)
WINGS = shapely.box(0.0, 0.0, 30.0, 24.0) - shapely.box(13.0, 8.0, 16.2, 24.0)
BLOCK = shapely.box(0.0, 0.0, 60.0, 50.0) - shapely.union_all(
    [shapely.box(*yard) for yard in ((8, 8, 26, 24), (34, 8, 52, 24), (8, 30, 52, 42))]
)
HOUSE = shapely.box(39.0, 0.0, 50.0, 12.0)


def seen(shape, angle=0.0, seed=0):
    """Roof points of a shape, and the ground about it."""
    rng = np.random.default_rng(seed)
    west, south, east, north = shape.buffer(15.0).bounds
    x, y = np.meshgrid(np.arange(west, east, SPACING), np.arange(south, north, SPACING))
    xy = np.column_stack([x.ravel(), y.ravel()]) + rng.uniform(-0.2, 0.2, (x.size, 2))
    is_roof = shapely.contains_xy(shape, *xy.T)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    xyz = np.column_stack([xy @ turn.T, np.where(is_roof, 8.0, 0.0)])
    truth = shapely.transform(shape, lambda at: at @ turn.T)
    return xyz[is_roof], xyz[~is_roof], truth


@pytest.mark.parametrize("angle", [0.0, 0.5])
@pytest.mark.parametrize(("shape", "n_holes"), [(YARD, 1), (WINGS, 0)])
def test_what_is_narrower_than_the_window_is_open_where_ground_was_seen(shape, n_holes, angle):
    points, ground, truth = seen(shape, angle)
    blind = trace_boundary(points, point_spacing=SPACING)
    traced = trace_boundary(points, point_spacing=SPACING, ground=ground)
    assert_sound(traced, points)
    assert not blind.outline.holes
    assert len(traced.outline.holes) == n_holes
    open_place = truth.convex_hull - truth
    shares = [polygon(one.outline).intersection(open_place).area / open_place.area for one in (blind, traced)]
    assert shares[0] > 0.7
    assert shares[1] < 0.35


def test_order_and_repetition_do_not_matter():
    points, ground, _ = seen(YARD)
    traced = trace_boundary(points, point_spacing=SPACING, ground=ground)
    rng = np.random.default_rng(1)
    again = trace_boundary(
        rng.permutation(points),
        point_spacing=SPACING,
        ground=rng.permutation(np.vstack([ground, ground[:40]])),
    )
    assert again.outline.same_as(traced.outline)


def test_ground_under_eaves_and_away_from_the_building_changes_nothing():
    points, ground, _ = seen(shapely.box(0.0, 0.0, 20.0, 14.0))
    below = points[::3] + np.array([0.4, 0.3, -8.0])
    traced = trace_boundary(points, point_spacing=SPACING)
    for some in (ground, below, np.vstack([ground, below]), np.zeros((0, 3))):
        assert trace_boundary(points, point_spacing=SPACING, ground=some).outline.same_as(traced.outline)


def test_less_than_a_courtyard_stays_closed():
    points, ground, _ = seen(YARD)
    wide = BoundaryTracingConfig(min_courtyard_area=200.0)
    traced = trace_boundary(points, wide, point_spacing=SPACING, ground=ground)
    assert traced.outline.same_as(trace_boundary(points, wide, point_spacing=SPACING).outline)


def test_without_courtyards_ground_has_no_say():
    points, ground, _ = seen(WINGS)
    outer = BoundaryTracingConfig(courtyards=False)
    traced = trace_boundary(points, outer, point_spacing=SPACING, ground=ground)
    assert traced.outline.same_as(trace_boundary(points, outer, point_spacing=SPACING).outline)
    assert not traced.outline.same_as(trace_boundary(points, point_spacing=SPACING, ground=ground).outline)


def test_a_building_that_hangs_together_across_ground_keeps_one_ring_round_all_its_points():
    points, ground, _ = seen(WINGS | HOUSE)
    points = np.vstack([points, [[34.5, 6.0, 8.0]]])
    lane = WINGS.convex_hull - WINGS
    traced = trace_boundary(points, point_spacing=SPACING, ground=ground)
    assert_sound(traced, points)
    assert polygon(traced.outline).intersection(lane).area < 0.35 * lane.area
    blind = trace_boundary(points, point_spacing=SPACING)
    assert polygon(blind.outline).intersection(lane).area > 0.7 * lane.area


@pytest.mark.parametrize(("shape", "seed"), [*((WINGS, seed) for seed in (0, 5, 15, 21, 27)), (BLOCK, 23)])
def test_a_ring_across_wider_gaps_does_not_close_what_was_open(shape, seed):
    is_closed = _closed(shape, seed)
    assert is_closed.sum() <= 0.12 * is_closed.size


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_yard_narrower_than_discs_is_open_by_ground_with_a_point_a_cell(seed):
    spacing, yard = 0.4, shapely.box(6.0, 3.0, 8.5, 11.0)
    points, ground = _scattered(shapely.box(0.0, 0.0, 14.0, 14.0) - yard, spacing, seed)
    ground = ground[np.unique(np.floor(ground / GROUND_CELL), axis=0, return_index=True)[1]]
    blind = trace_boundary(points, point_spacing=spacing)
    traced = trace_boundary(points, point_spacing=spacing, ground=ground)
    assert_sound(traced, points)
    held = [polygon(one.outline).intersection(yard).area / yard.area for one in (blind, traced)]
    assert held[0] > 0.9
    assert held[1] < 0.1


def _closed(shape, seed):
    """Tell which open ground within the hull of a shape a ring round points at random places holds."""
    points, ground = _scattered(shape, SPACING, seed)
    traced = trace_boundary(points, point_spacing=SPACING, ground=ground)
    assert_sound(traced, points)
    is_clear = cKDTree(points[:, :2]).query(ground)[0] > SPACING
    clear = ground[is_clear & shapely.contains_xy(shape.convex_hull, *ground.T)]
    return shapely.contains_xy(polygon(traced.outline), *clear.T)


def _scattered(shape, spacing, seed):
    """Roof points of a shape, and the ground about it in plan, at random places."""
    rng = np.random.default_rng(seed)
    west, south, east, north = shape.buffer(15.0).bounds
    xy = rng.uniform((west, south), (east, north), (int((east - west) * (north - south) / spacing**2), 2))
    is_roof = shapely.contains_xy(shape, *xy.T)
    return np.column_stack([xy[is_roof], np.full(is_roof.sum(), 8.0)]), xy[~is_roof]
