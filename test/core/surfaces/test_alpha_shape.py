"""Alpha shapes against their definition, tried out disc by disc."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from lidar_buildings.core.surfaces.alpha_shape import alpha_shape

#: A disc that overlaps a point by so little of an angle is empty [rad].
TOUCH = 1e-6


def on_rim_of_empty_disc(points, alpha):
    """
    Whether a disc with each point on its rim is empty: its centre is on a circle round the point, of which
    every other point takes an arc; where something is left, it is so at the end of an arc.
    """
    found = np.zeros(len(points), dtype=bool)
    for i, point in enumerate(points):
        x, y = (points - point).T
        distance = np.hypot(x, y)
        near = (distance > 0) & (distance < 2 * alpha)
        middle, half = np.arctan2(y[near], x[near]), np.arccos(distance[near] / (2 * alpha))
        ends = np.concatenate((middle - half, middle + half))
        apart = np.abs((ends[:, None] - middle + np.pi) % (2 * np.pi) - np.pi)
        found[i] = not near.any() or (apart >= half - TOUCH).all(axis=1).any()
    return found


def discs_on_both(points, i, j, alpha):
    """
    Numbers of points inside the two discs with both points on their rims; none if they are too far apart.
    """
    middle, way = (points[i] + points[j]) / 2, points[j] - points[i]
    length = np.hypot(*way)
    if length > 2 * alpha:
        return []
    offset = math.sqrt(max(alpha**2 - length**2 / 4, 0.0)) * np.array([-way[1], way[0]]) / length
    centres = (middle + offset, middle - offset)
    return [np.sum(np.hypot(*(points - centre).T) < alpha * (1 - 1e-9)) for centre in centres]


def edges_by_discs(points, alpha):
    """Pairs of points that an empty disc has on its rim."""
    n = len(points)
    return {(i, j) for i in range(n) for j in range(i + 1, n) if 0 in discs_on_both(points, i, j, alpha)}


def random_points(seed, n=60, digits=None):
    points = np.random.default_rng(seed).uniform(0, 10, (n, 2))
    return points if digits is None else np.round(points, digits)


def lattice(columns, rows, step=1.0):
    x, y = np.meshgrid(np.arange(columns) * step, np.arange(rows) * step)
    return np.column_stack((x.ravel(), y.ravel()))


@pytest.mark.parametrize("digits", [None, 1, 0])
@pytest.mark.parametrize("alpha", [0.2, 0.6, 1.1, 3.0, 30.0, 1000.0])
def test_a_point_is_on_the_shape_if_an_empty_disc_has_it_on_its_rim(digits, alpha):
    for seed in range(8):
        points = random_points(seed, 10 + 8 * seed, digits)
        found = alpha_shape(points, alpha).is_boundary
        np.testing.assert_array_equal(found, on_rim_of_empty_disc(points, alpha))


@pytest.mark.parametrize("alpha", [0.3, 0.7, 1.3, 4.0, 50.0])
def test_two_points_are_joined_if_an_empty_disc_has_both_on_its_rim(alpha):
    for seed in range(6):
        points = random_points(seed, 40)
        shape = alpha_shape(points, alpha)
        assert {tuple(sorted(edge)) for edge in shape.edges.tolist()} == edges_by_discs(points, alpha)
        assert shape.is_boundary[shape.edges].all()


points_of_all_kinds = st.lists(
    st.tuples(st.integers(-12, 12), st.integers(-12, 12)), min_size=0, max_size=40
).map(lambda rows: np.array(rows, dtype=float).reshape(-1, 2))


@settings(max_examples=80, deadline=None)
@given(points=points_of_all_kinds, alpha=st.floats(0.3, 40.0), seed=st.integers(0, 2**16))
def test_neither_order_nor_copies_nor_where_the_points_lie_nor_their_scale_matter(points, alpha, seed):
    shape = alpha_shape(points, alpha)
    order = np.random.default_rng(seed).permutation(len(points))
    shuffled = alpha_shape(points[order], alpha)
    np.testing.assert_array_equal(shuffled.is_boundary, shape.is_boundary[order])
    copied = alpha_shape(np.vstack((points, points)), alpha)
    np.testing.assert_array_equal(copied.is_boundary, np.tile(shape.is_boundary, 2))
    moved = alpha_shape(points * 0.25 + [85_000.0, 447_000.0], alpha * 0.25)
    np.testing.assert_array_equal(moved.is_boundary, shape.is_boundary)
    for other, scale in ((shuffled, 1.0), (copied, 1.0), (moved, 0.25)):
        assert other.area == pytest.approx(shape.area * scale**2, abs=1e-4)
        assert len(other.polygons) == len(shape.polygons)
    positions = [sorted(s.points[s.edges].reshape(-1, 4).tolist()) for s in (shape, copied)]
    assert positions[0] == positions[1]


@settings(max_examples=80, deadline=None)
@given(points=points_of_all_kinds, alpha=st.floats(0.3, 40.0))
def test_polygons_are_valid_and_hold_what_the_triangles_hold(points, alpha):
    shape = alpha_shape(points, alpha)
    polygons = shape.polygons
    assert shapely.is_valid(polygons).all()
    triangles = shapely.union_all(shapely.polygons(points[shape.triangles]))
    assert shapely.union_all(polygons).symmetric_difference(triangles).area < 1e-9
    assert shapely.area(polygons).sum() == pytest.approx(shape.area, abs=1e-9)
    regular = alpha_shape(points, alpha, regularised=True)
    corners = {tuple(xy) for xy in shapely.get_coordinates(polygons).tolist()}
    assert {tuple(xy) for xy in points[regular.is_boundary].tolist()} == corners


@settings(max_examples=40, deadline=None)
@given(points=points_of_all_kinds, alpha=st.floats(0.3, 20.0))
def test_a_larger_disc_leaves_fewer_points_on_the_shape_and_more_area(points, alpha):
    small, large = alpha_shape(points, alpha), alpha_shape(points, 1.5 * alpha)
    assert not (large.is_boundary & ~small.is_boundary).any()
    assert large.area >= small.area - 1e-9


def test_the_regularised_shape_leaves_out_what_bounds_no_area():
    square, row, stray = lattice(4, 4), [[5.0, 1.0], [6.2, 1.0]], [[20.0, 20.0]]
    points = np.vstack((square, row, stray))
    general, regular = (alpha_shape(points, 1.0, regularised=choice) for choice in (False, True))
    assert general.is_boundary[16:].all()
    assert len(general.edges) == 12 + 2
    assert not regular.is_boundary[16:].any()
    assert (general.is_boundary[:16] == regular.is_boundary[:16]).all()
    assert regular.is_boundary.sum() == regular.n_area_edges == len(regular.edges) == 12


def test_courtyards_are_holes_and_a_house_within_is_a_polygon_of_its_own():
    points = lattice(31, 31, 0.5)
    radius = np.abs(points - 7.5).max(axis=1)
    shape = alpha_shape(points[(radius > 4.9) | (radius < 2.1)], 0.6)
    outer, inner = shape.polygons
    assert (len(outer.interiors), len(inner.interiors)) == (1, 0)
    # The disc cuts the four corners of the courtyard.
    assert outer.area == pytest.approx(15**2 - 10**2 + 4 * 0.5**2 / 2)
    assert inner.area == pytest.approx(4**2)


def test_parts_that_meet_in_a_corner_are_polygons_of_their_own():
    shape = alpha_shape([[0, 0], [1, 0.5], [1, -0.5], [-1, 0.5], [-1, -0.5]], 1.0)
    assert [polygon.area for polygon in shape.polygons] == [0.5, 0.5]
    assert shapely.touches(*shape.polygons)
    assert shape.is_boundary.all()


@pytest.mark.parametrize(
    ("points", "n_edges"),
    [
        (np.zeros((0, 2)), 0),
        ([[3.0, 4.0]], 0),
        ([[3.0, 4.0]] * 10, 0),
        ([[0.0, 0.0], [1.0, 1.0]], 1),
        ([[0.0, 0.0], [9.0, 9.0]], 0),
        (np.column_stack((np.arange(20.0), 0.3 * np.arange(20.0))), 19),
        (np.column_stack((np.zeros(20), np.repeat(np.arange(10.0), 2))), 9),
    ],
    ids=["none", "one", "identical", "two", "two far apart", "collinear", "collinear twice"],
)
def test_all_points_are_on_a_shape_without_area(points, n_edges):
    shape = alpha_shape(points, 0.9)
    assert shape.is_boundary.all()
    assert len(shape.edges) == n_edges
    assert shape.area == 0.0
    assert len(shape.polygons) == 0
    assert not alpha_shape(points, 0.9, regularised=True).is_boundary.any()


def test_an_infinite_disc_gives_the_convex_hull_with_the_points_on_its_sides():
    points = np.vstack((random_points(3, 500), lattice(2, 11) * [12.0, 1.2] - 1.0))
    shape = alpha_shape(points, np.inf)
    hull = shapely.convex_hull(shapely.multipoints(points))
    on_hull = shapely.distance(shapely.points(points), hull.exterior) < 1e-9
    np.testing.assert_array_equal(shape.is_boundary, on_hull)
    assert shape.polygons[0].equals(hull)
    np.testing.assert_array_equal(alpha_shape(points, 1e300).is_boundary, on_hull)


@pytest.mark.parametrize("factor", [1e-200, 1e-30, 1e30, 1e300])
def test_coordinates_may_be_tiny_or_enormous(factor):
    points = random_points(5, 200)
    expected = alpha_shape(points, 0.7).is_boundary
    np.testing.assert_array_equal(alpha_shape(points * factor, 0.7 * factor).is_boundary, expected)
    assert alpha_shape(np.array([[-1.7e308, 0.0], [1.7e308, 1.0], [0.0, 1e308]]), 1.0).is_boundary.all()


def test_points_on_one_circle_are_all_on_the_shape_or_its_area_is_round():
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    points = 5.0 * np.column_stack((np.cos(angle), np.sin(angle)))
    assert alpha_shape(points, 5.1).area == pytest.approx(np.pi * 25, rel=1e-3)
    assert alpha_shape(points, 4.9).area == 0.0
    for alpha in (4.9, 5.1):
        assert alpha_shape(points, alpha).is_boundary.all()


@pytest.mark.parametrize("rotation", [0.0, 0.3])
def test_of_a_lattice_the_rim_is_the_shape_whatever_the_rounding(rotation):
    turn = [[np.cos(rotation), np.sin(rotation)], [-np.sin(rotation), np.cos(rotation)]]
    points = lattice(60, 50, 0.45) @ np.array(turn)
    shape = alpha_shape(points, 0.6)
    assert shape.is_boundary.sum() == shape.n_area_edges == 2 * (60 + 50) - 4
    # Four points on one circle of just this radius: the disc is empty, and every point is on its rim.
    assert alpha_shape(points, 0.45 / math.sqrt(2)).is_boundary.all()


def test_elevations_are_not_looked_at():
    points = np.column_stack((random_points(1), np.full(60, np.nan)))
    np.testing.assert_array_equal(
        alpha_shape(points, 1.0).is_boundary, alpha_shape(points[:, :2], 1.0).is_boundary
    )


@pytest.mark.parametrize("alpha", [0.0, -1.0, np.nan, -np.inf])
def test_a_radius_that_is_not_positive_is_refused(alpha):
    with pytest.raises(ValueError, match=r"alpha = .*: must be a positive radius"):
        alpha_shape(np.zeros((3, 2)), alpha)


def test_wrong_points_are_refused():
    with pytest.raises(ValueError, match=r"points has shape \(3, 1\)"):
        alpha_shape(np.zeros((3, 1)), 1.0)
    for value in (np.nan, np.inf):
        points = np.zeros((3, 2))
        points[1, 0] = value
        with pytest.raises(ValueError, match=r"points\[1\] = .*: coordinates must be finite"):
            alpha_shape(points, 1.0)
