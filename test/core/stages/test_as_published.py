"""Formulas of the papers that only presets use, against values computed by hand."""

import math

import numpy as np
import pytest

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.boundary_tracing.point_grid import build_point_grid
from lidar_buildings.core.stages.boundary_tracing.tracing import rows_to_trace
from lidar_buildings.core.stages.ground_filter.bidirectional_slope import objects_between_slopes
from lidar_buildings.core.stages.ground_filter.classification import classify_ground
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.progressive_tin import facet_offsets, histogram_limits
from lidar_buildings.core.stages.plane_fitting.ransac import best_plane
from lidar_buildings.core.stages.regularisation.config import RegularisationConfig
from lidar_buildings.core.stages.regularisation.directions import (
    adjusted_directions,
    divide_at_turns,
    min_long_length,
)
from lidar_buildings.core.stages.regularisation.regularising import _problem
from lidar_buildings.core.stages.regularisation.samples import sample_ring
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.roads import _say_one_mode, road_greys
from lidar_buildings.core.stages.roof_selection.selection import select_roofs
from lidar_buildings.core.surfaces.ring_division import Division
from lidar_buildings.core.surfaces.triangulation import build_tin


def test_limits_lie_as_far_above_the_median_as_the_minimum_below_or_at_the_maximum():
    distances, angles = [1.0, 2.0, 3.0, 10.0], [0.0, 2.0, 2.5, 3.0]
    assert histogram_limits(np.column_stack((distances, angles))).tolist() == [4.0, 3.0]


def test_distance_and_angle_are_taken_to_the_facet_and_at_its_nearest_corner():
    tin = build_tin([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]])
    above, below = facet_offsets(tin, np.array([[1.0, 1.0, 1.0], [1.0, 1.0, -1.0]]))
    assert above == pytest.approx([1.0, np.arcsin(1.0 / np.sqrt(3.0))])
    assert below == pytest.approx(-above)


@pytest.mark.parametrize("slope", [0.0, 0.1])
def test_an_even_plane_is_terrain_though_limits_are_renewed(slope):
    random = np.random.default_rng(0)
    xy = random.uniform(0.0, 100.0, (19000, 2))
    points = np.column_stack([xy, slope * xy[:, 0] + random.normal(0.0, 0.05, len(xy))])
    config = GroundFilterConfig(
        method="histogram_tin", iteration_angle=6.0, iteration_distance=1.4, ground_distance=0.12
    )
    assert (classify_ground(points, config).classification == 2).mean() > 0.98


@pytest.mark.parametrize(
    ("z", "objects"),
    [
        ([0, 0, 5, 5, 0.1, 0], [2, 3]),  # between a rise and a fall
        ([0, 0, 3, 3.5, 3, 0, 0], [2, 3, 4]),  # a roof of gentle slopes
        ([0, 0, 5, 5, 3, 0, 0], [2, 3, 4]),  # a fall to no more than a balcony ends nothing
        ([5, 5, 0, 0], [0, 1]),  # cut by the line's end: one pass sees the rise
        ([0, 0.5, 1.0, 1.5], []),  # a hill
    ],
)
def test_what_lies_between_a_rise_and_a_fall_is_no_ground(z, objects):
    z = np.array(z, dtype=float)
    found = objects_between_slopes(np.arange(float(len(z))), z, np.array([0, len(z)]), (0.6, 0.35, 80.0))
    assert np.flatnonzero(found).tolist() == objects


def test_roads_are_grey_from_40_to_100():
    grey, single = np.array([39.0, 40.0, 100.0, 101.0]), np.ones(4, dtype=bool)
    found = road_greys(np.zeros((4, 3)), grey, single, 1.0, RoofSelectionConfig(), dark_limit=70.0)
    assert found.tolist() == [False, True, True, False]


@pytest.mark.parametrize(("bits", "gain"), [(8, 1.0), (16, 180.0)])
def test_roads_are_found_whatever_number_of_bits_was_recorded(bits, gain):
    random = np.random.default_rng(bits)
    xy = random.uniform(0.0, 60.0, (6000, 2))
    is_road = xy[:, 0] < 20.0
    recorded = gain * (np.where(is_road, 55.0, 148.0) + random.normal(0.0, 8.0, len(xy)))
    is_wet = random.random(len(xy)) < 0.03
    recorded[is_wet] = gain * random.uniform(2.0, 8.0, is_wet.sum())
    points = np.column_stack([xy, np.zeros(len(xy))])
    ground, config = np.full(len(xy), 2, dtype=np.uint8), RoofSelectionConfig(road_method="grey_values")
    classes = select_roofs(
        points, config, height_above_ground=np.zeros(len(xy)), classification=ground, intensity=recorded
    ).classification
    assert (classes[~is_road] == 2).mean() > 0.99
    assert (classes[is_road & ~is_wet] == 11).mean() > 0.95


@pytest.mark.parametrize("n_modes", [1, 2])
def test_ground_of_one_brightness_is_told_once(n_modes, caplog):
    _say_one_mode.cache_clear()
    random = np.random.default_rng(0)
    xy = random.uniform(0.0, 90.0, (30000, 2))
    bright = 60.0 + 90.0 * ((xy[:, 0] > 45.0) & (n_modes == 2)) + random.normal(0.0, 5.0, len(xy))
    for _ in range(2):
        ground = np.column_stack([xy, 0.0 * bright])
        road_greys(ground, bright, np.ones(len(xy), dtype=bool), 0.5, RoofSelectionConfig())
    assert len(caplog.records) == (n_modes == 1)


def test_a_consensus_as_large_as_any_plane_ends_the_search():
    low = [[x, y, 0.0] for x in (0.0, 1.0) for y in (0.0, 1.0)]
    high = [[x, y, 5.0] for x in (0.0, 1.0, 2.0) for y in (0.0, 1.0)]
    points, samples = np.array(low + high), np.array([[0.0, 0.1, 0.2], [0.4, 0.5, 0.6]])
    assert [int(best_plane(points, samples, 0.1, enough).sum()) for enough in (4, 5)] == [4, 6]


def test_a_square_of_slightly_more_than_two_spacings_holds_the_diagonal_neighbours():
    def n_neighbours(**shape):
        grid = build_point_grid(np.zeros((1, 2)), ScanPattern.isotropic(1.0), 2.2, **shape)
        lattice = np.array([(x, y) for x in (-2, -1, 0, 1, 2) for y in (-2, -1, 0, 1, 2)])
        u, v = np.array([[grid.ux, grid.uy], [grid.vx, grid.vy]]) @ lattice.T
        return int(((np.hypot(u, v) if grid.is_disc else np.maximum(abs(u), abs(v))) <= 1.0).sum()) - 1

    assert (n_neighbours(is_rectangle=True), n_neighbours()) == (8, 4)


def test_the_ring_is_traced_from_the_edge_points_unless_they_are_too_few():
    rows, edge = np.arange(6), np.array([1, 1, 0, 1, 1, 0], dtype=np.uint8)
    config = BoundaryTracingConfig(source="edge_points")
    assert rows_to_trace(rows, edge, config).tolist() == [0, 1, 3, 4]
    assert rows_to_trace(rows[1:], edge, config).tolist() == [1, 2, 3, 4, 5]
    assert rows_to_trace(rows, edge, BoundaryTracingConfig()).tolist() == rows.tolist()


def test_walls_that_have_passed_each_other_are_no_outline():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    ring = Outline(np.repeat(square, 2, axis=0))
    assert "valid" in _problem(Outline(square[::-1]), ring)
    assert _problem(Outline(square), ring) == ""


def test_consecutive_edges_of_a_round_tower_have_similar_slopes():
    angle = np.deg2rad(np.arange(0.0, 360.0, 30.0))
    tower = np.column_stack((np.cos(angle), np.sin(angle)))
    assert len(divide_at_turns(sample_ring(tower, 0.5, None), np.deg2rad(40.0))[1].first) == 1


def test_long_walls_have_10_m_where_any_has():
    config = RegularisationConfig(min_long_wall=10.0)
    assert [min_long_length(lengths, 1.0, config) for lengths in ([4.0, 30.0], [4.0, 8.0])] == [10.0, 4.0]


def test_all_walls_adjust_both_directions_and_the_long_ones_hold_them():
    """A rectangle of 20 by 12 points, directions 0.01 rad off: Σ(t − mean)² = n (n² − 1) / 12."""
    x, y = np.arange(20.0), np.arange(12.0)
    sides = [(x, 0 * x), (0 * y + 20, y), (20 - x, 0 * x + 12), (0 * y, 12 - y)]
    ring = np.concatenate([np.column_stack(side) for side in sides])
    first, last = np.array([0, 20, 32, 52]), np.array([20, 32, 52, 64])
    division = Division(first, last, np.array([0, 1, 0, 1]), 0.0)
    samples = sample_ring(ring, 1.0, None)
    given = np.array([np.pi / 2, 0.0]) + 0.01
    config = RegularisationConfig(direction_sigma_deg=math.degrees(0.3 / 20.0), min_long_wall=10.0)
    weight = 400.0  # (noise / sigma)²
    turned = adjusted_directions([samples], [division], given, 1.0, config) - given
    a, b = (along * weight / (along + weight) for along in (20 * 399 / 12, 12 * 143 / 12))
    held = 4 * weight
    assert turned == pytest.approx([-0.02 * a / (held + 2 * a), -0.02 * b / (held + 2 * b)], rel=1e-3)
