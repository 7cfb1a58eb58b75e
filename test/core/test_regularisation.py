import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scenes import GALLERY

from lidar_buildings.core.boundary_tracing import trace_boundary
from lidar_buildings.core.outline import Outline, signed_area
from lidar_buildings.core.regularisation import (
    RegularisationConfig,
    measure_outline,
    regularise_outline,
)
from lidar_buildings.core.regularisation.division import FREE, Costs, divide_ring
from lidar_buildings.core.regularisation.lines import Line, free_line, shared_directions, weighted_line
from lidar_buildings.core.status import BuildingStatus

CORNERS = {"flat": 4, "gable": 4, "hip": 4, "step_roof": 4, "l_shape": 6, "t_shape": 8, "courtyard": 4}
ROTATIONS = (0.0, 17.0, 45.0, 78.0)


def polygon(outline):
    return shapely.Polygon(outline.exterior, outline.holes)


def overlap(one, other):
    return one.intersection(other).area / one.union(other).area


def turned(xy, angle_deg):
    angle = np.deg2rad(angle_deg)
    return xy @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def noisy_ring(corners, step=0.5, noise=0.1, seed=0):
    """
    Points along a polygon's edges, moved about at random.

    """
    rng = np.random.default_rng(seed)
    parts = []
    for a, b in zip(np.array(corners, float), np.roll(corners, -1, axis=0), strict=True):
        t = np.arange(0.0, 1.0, step / np.hypot(*(b - a)))[:, None]
        parts.append(a + t * (b - a))
    ring = np.vstack(parts)
    return ring + rng.normal(0, noise, ring.shape)


def corner_angles_deg(ring):
    edges = np.roll(ring, -1, axis=0) - ring
    heading = np.arctan2(edges[:, 1], edges[:, 0])
    return np.rad2deg(np.abs((np.diff(heading, append=heading[:1]) + np.pi) % (2 * np.pi) - np.pi))


@pytest.mark.parametrize("rotation_deg", ROTATIONS)
@pytest.mark.parametrize("name", CORNERS)
def test_a_rectilinear_house_gets_its_number_of_corners_all_of_them_right_angles(name, rotation_deg):
    scene = GALLERY[name](rotation_deg=rotation_deg)
    traced = trace_boundary(scene.roof_points())
    result = regularise_outline(traced.outline)
    assert (result.status, result.reason) == (BuildingStatus.OK, "")
    assert len(result.outline.exterior) == CORNERS[name]
    assert np.allclose(corner_angles_deg(result.outline.exterior), 90.0, atol=1.0)
    assert overlap(polygon(result.outline), scene.buildings[0].polygon) > 0.93
    # Half a degree is the accuracy of a 10 m wall's direction at this density.
    error = (np.rad2deg(result.directions[0]) - rotation_deg + 45.0) % 90.0 - 45.0
    assert abs(error) < 1.0
    # The paper finds 0.2 spacings and about one; our points are random, theirs are on scan lines.
    assert result.sigma < 0.5 * traced.point_spacing
    assert result.max_offset < 2.0 * traced.point_spacing


def test_a_courtyard_keeps_its_four_corners_inside():
    scene = GALLERY["courtyard"](rotation_deg=30.0)
    outline = regularise_outline(trace_boundary(scene.roof_points()).outline).outline
    assert [len(ring) for ring in outline.rings] == [4, 4]
    assert signed_area(outline.exterior) > 0 > signed_area(outline.holes[0])
    assert polygon(outline).is_valid


@pytest.mark.parametrize("density", [0.5, 2.0, 30.0])
def test_an_l_shaped_house_has_six_corners_at_any_density(density):
    scene = GALLERY["l_shape"](density=density, rotation_deg=25.0)
    outline = regularise_outline(trace_boundary(scene.roof_points()).outline).outline
    assert len(outline.exterior) == 6


def test_a_round_tower_stays_round():
    scene = GALLERY["round_tower"]()
    traced = trace_boundary(scene.roof_points())
    result = regularise_outline(traced.outline)
    assert polygon(result.outline).is_valid
    assert overlap(polygon(result.outline), polygon(traced.outline)) > 0.95
    assert result.max_offset < 1.5 * traced.point_spacing
    assert len(result.outline.exterior) >= 8


def test_a_slanting_wall_keeps_its_direction():
    ring = noisy_ring([(0, 0), (20, 0), (20, 8), (12, 16), (0, 16)])
    result = regularise_outline(Outline(ring))
    assert len(result.outline.exterior) == 5
    angles = sorted(corner_angles_deg(result.outline.exterior))
    assert np.allclose(angles, [45, 45, 90, 90, 90], atol=3.0)


def test_wings_at_an_odd_angle_have_directions_of_their_own():
    bend = turned(np.array([(0, 0), (20, 0), (20, 8), (0, 8)]), 33.0) + np.array([20, 0])
    wings = shapely.union(shapely.box(0, -8, 21, 1), shapely.Polygon(bend))
    ring = noisy_ring(shapely.get_coordinates(wings.exterior)[:-1])
    result = regularise_outline(Outline(ring).oriented())
    found = np.rad2deg(result.directions)
    for expected in (0.0, 33.0):
        assert np.abs((found - expected + 45) % 90 - 45).min() < 1.5


def test_scan_stairs_disappear_and_real_steps_stay():
    corners = [(0, 0), (20, 0), (20, 10), (10, 10), (10, 12), (0, 12)]
    assert len(regularise_outline(Outline(noisy_ring(corners))).outline.exterior) == 6
    # A rectangle 20° askew to the scan lines: the ring goes up in stairs.
    x, y = np.meshgrid(np.arange(-20.0, 20.0, 0.3), np.arange(-20.0, 20.0, 0.6))
    lines = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    u, v = turned(lines[:, :2], -20.0).T
    traced = trace_boundary(lines[(np.abs(u) < 9.0) & (np.abs(v) < 5.0)])
    outline = regularise_outline(traced.outline).outline
    assert len(outline.exterior) == 4
    assert np.rad2deg(regularise_outline(traced.outline).directions[0]) == pytest.approx(20.0, abs=1.5)


def test_the_outline_turns_and_moves_with_the_ring():
    ring = trace_boundary(GALLERY["t_shape"]().roof_points()).outline.exterior
    expected = regularise_outline(Outline(ring)).outline.exterior
    for angle_deg, shift in ((31.0, (0.0, 0.0)), (90.0, (500.0, -900.0)), (211.0, (0.0, 3e4))):
        moved = regularise_outline(Outline(turned(ring, angle_deg) + shift)).outline
        assert overlap(polygon(moved), shapely.Polygon(turned(expected, angle_deg) + shift)) > 0.99


def test_the_start_of_the_ring_hardly_matters():
    ring = trace_boundary(GALLERY["l_shape"](rotation_deg=12.0).roof_points()).outline.exterior
    expected = polygon(regularise_outline(Outline(ring)).outline)
    for shift in (1, 20, 77):
        again = regularise_outline(Outline(np.roll(ring, shift, axis=0))).outline
        assert overlap(polygon(again), expected) > 0.99


@pytest.mark.parametrize(
    ("ring", "reason"),
    [
        (np.zeros((0, 2)), "too few"),
        (np.array([(0, 0), (1, 0), (0, 1)]), "too few"),
        (np.zeros((30, 2)), ""),
        (np.column_stack([np.arange(30.0), np.zeros(30)]), ""),
    ],
)
def test_what_cannot_be_regularised_is_returned_as_traced_with_a_reason(ring, reason):
    traced = Outline(np.asarray(ring, dtype=np.float64))
    result = regularise_outline(traced)
    assert result.status is BuildingStatus.TRACED_OUTLINE
    assert result.outline.same_as(traced)
    assert result.reason
    assert reason in result.reason
    assert (result.sigma, result.max_offset) == (0.0, 0.0)


@settings(max_examples=80, deadline=None)
@given(arrays(np.float32, st.tuples(st.integers(9, 80), st.just(2)), elements=st.floats(-50, 50, width=16)))
def test_any_cloud_gets_a_valid_outline(xy):
    traced = trace_boundary(np.column_stack([xy.astype(np.float64), np.zeros(len(xy))]))
    result = regularise_outline(traced.outline)
    assert polygon(result.outline).is_valid
    assert polygon(result.outline).area > 0
    assert (result.status is BuildingStatus.TRACED_OUTLINE) == result.outline.same_as(traced.outline)


def test_a_neck_where_straight_walls_would_cross_leaves_the_other_walls_straight():
    blocks = shapely.union_all([shapely.box(0, 0, 12, 10), shapely.box(12.2, 10.2, 24, 20)])
    bridge = shapely.Polygon([(11.8, 9.9), (12.4, 10.2), (12.3, 10.4), (11.7, 10.0)])
    shape = shapely.union(blocks, bridge)
    ring = shapely.get_coordinates(shapely.segmentize(shape, 0.4).exterior)[:-1]
    result = regularise_outline(Outline(ring).oriented())
    assert result.status is BuildingStatus.OK
    assert polygon(result.outline).is_valid
    assert overlap(polygon(result.outline), shape) > 0.95
    assert len(result.outline.exterior) < 20


def test_measuring_from_the_two_outlines_alone_gives_the_same_quality():
    traced = trace_boundary(GALLERY["hip"]().roof_points()).outline
    result = regularise_outline(traced)
    quality = measure_outline(traced, result.outline)
    assert (quality.sigma, quality.max_offset) == (result.sigma, result.max_offset)
    assert quality.status is BuildingStatus.OK
    strict = RegularisationConfig(min_overlap=1.0)
    kept = regularise_outline(traced, strict)
    again = measure_outline(traced, kept.outline, strict)
    assert again.status is BuildingStatus.TRACED_OUTLINE
    assert again.reason == kept.reason != ""


def test_the_adjusted_line_lies_between_the_points_and_the_given_direction():
    along = np.linspace(-5, 5, 50)
    points = np.column_stack([along, 0.1 * along + 3.0])
    own = free_line(points)
    assert np.allclose(points @ own.normal, own.offset)
    for weight, share in ((0.0, 1.0), (1.0, 0.5), (1e9, 0.0)):
        line = weighted_line(points, np.pi / 2, weight)
        # Half of the way is exact for small angles only.
        assert line.angle - np.pi / 2 == pytest.approx(0.1 * share, abs=1e-3)


def test_lines_meet_where_both_equations_hold():
    one, other = Line(0.3, 2.0), Line(1.9, -1.0)
    point = one.meeting(other)
    assert point @ one.normal == pytest.approx(2.0)
    assert point @ other.normal == pytest.approx(-1.0)
    assert one.meeting(Line(0.3, 5.0)) is None


def test_shared_directions_are_those_of_a_joint_adjustment():
    rng = np.random.default_rng(0)
    angle = np.deg2rad(20.0)
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    t = np.linspace(0, 20, 60)[:, None]
    walls = [t * along, t * along + 9 * across, t * across, t * across + 20 * along]
    walls = [wall + rng.normal(0, 0.1, wall.shape) for wall in walls]
    (found,) = shared_directions(walls, np.deg2rad(10), 0.1, 15.0, 3)
    assert np.rad2deg(found) == pytest.approx(20.0, abs=0.2)


def test_the_division_is_the_best_of_all():
    """
    Try every division of a small chain by brute force.

    """
    ring = noisy_ring([(0, 0), (4, 0), (4, 3), (0, 3)], step=1.0, noise=0.05)
    angles, costs = np.array([0.0, np.pi / 2]), Costs(0.1, 5.0, 5.0, 5.0)

    def cost(walls):
        total, last = 0.0, None
        for first, end, k in walls:
            rows = ring[first:end] - ring[first:end].mean(axis=0)
            if k == FREE:
                if end - first < 3:
                    return np.inf
                total += np.linalg.eigvalsh(rows.T @ rows)[0] / costs.noise**2 + costs.own_direction
            else:
                total += np.sum((rows @ (np.cos(angles[k]), np.sin(angles[k]))) ** 2) / costs.noise**2
                total += costs.step if k == last else 0.0
            total += costs.wall
            last = k
        return total

    def cheapest(start, last):
        if start == len(ring):
            return 0.0
        key = (start, last)
        if key not in memory:
            memory[key] = min(
                cost([(start, end, k)]) + (costs.step if k == last != FREE else 0.0) + cheapest(end, k)
                for end in range(start + 1, len(ring) + 1)
                for k in (0, 1, FREE)
            )
        return memory[key]

    memory = {}
    walls = divide_ring(ring, angles, costs)
    shift = walls[0].first
    ring = np.roll(ring, -shift, axis=0)
    found = cost([(wall.first - shift, wall.last - shift, wall.direction) for wall in walls])
    assert found == pytest.approx(cheapest(0, None))
    assert len(walls) == 4
