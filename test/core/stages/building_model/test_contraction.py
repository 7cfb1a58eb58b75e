import numpy as np
import pytest
import shapely

from lidar_buildings.core.stages.building_model.contraction import contracted
from lidar_buildings.core.stages.building_model.spikes import limits_of

SPACING = 0.5
#: Two halves of a plan of 10 m × 6 m; the border between them has a jog of 0.2 m at y = 3.
LEFT = np.array([[0, 0], [5, 0], [5, 3], [5.2, 3], [5.2, 6], [0, 6]], dtype=float)
RIGHT = np.array([[5, 0], [10, 0], [10, 6], [5.2, 6], [5.2, 3], [5, 3]], dtype=float)
CORNERS = np.array([[0, 0], [10, 0], [10, 6], [0, 6]], dtype=float)
#: A low and a high roof.
PLANES = np.array([[0.0, 0.0, 4.0], [0.0, 0.0, 7.0]])
PRICES = (0.15 * SPACING, 0.1)


def roof(border_south, border_north):
    """Points of a low roof to the west and a high one to the east of borders, and what they lie over."""
    x, y = (np.arange(0.25, end, SPACING) for end in (10.0, 6.0))
    y, x = (one.ravel() for one in np.meshgrid(y, x, indexing="ij"))
    is_high = x > np.where(y < 3.0, border_south, border_north)
    over = (x > np.where(y < 3.0, 5.0, 5.2)).astype(np.int64)
    return np.column_stack([x, y, np.where(is_high, 7.0, 4.0)]), over


def contract(points, over, rings=((LEFT,), (RIGHT,)), kept=CORNERS, planes=PLANES):
    weights = np.full(len(points), SPACING**2)
    return contracted(rings, planes, over, kept, limits_of(points, SPACING, 0.0), points, weights, PRICES)


def test_a_jog_goes_where_points_do_not_tell_it():
    points, over = roof(5.0, 5.2)
    left, right = contract(points, over)
    assert len(left[0]) == len(right[0]) == 4
    whole = shapely.union_all([shapely.Polygon(left[0]), shapely.Polygon(right[0])])
    assert whole.equals(shapely.Polygon(CORNERS))


def test_a_jog_stays_where_points_tell_it():
    wide_left = np.where(LEFT == 5.2, 7.0, LEFT)
    wide_right = np.where(RIGHT == 5.2, 7.0, RIGHT)
    points, _ = roof(5.0, 7.0)
    over = (points[:, 2] > 5.0).astype(np.int64)
    left, right = contract(points, over.copy(), ((wide_left,), (wide_right,)))
    assert [len(left[0]), len(right[0])] == [6, 6]


def test_points_over_what_moved_lie_over_the_other_face():
    points, over = roof(5.0, 5.2)
    left, _ = contract(points, over)
    inside = shapely.contains_xy(shapely.Polygon(left[0]), points[:, 0], points[:, 1])
    assert np.array_equal(over == 0, inside)


def test_kept_vertices_stay():
    points, over = roof(5.0, 5.2)
    rings = contract(points, over, kept=np.concatenate([LEFT, RIGHT]))
    assert [len(ring[0]) for ring in rings] == [6, 6]


def test_no_vertex_moves_where_no_point_explains_the_roof():
    kept = np.array([*CORNERS, [5.0, 0.0], [5.0, 3.0], [5.2, 6.0]])
    points, over = roof(5.0, 5.2)
    assert [len(ring[0]) for ring in contract(points, over.copy(), kept=kept)] == [5, 5]
    away = np.min([np.hypot(*(points[:, :2] - end).T) for end in ((5.0, 3.0), (5.2, 6.0))], axis=0)
    is_seen = (points[:, 2] < 5.0) | (away > 3.5 * SPACING)
    rings = contract(points[is_seen], over[is_seen], kept=kept)
    assert [len(ring[0]) for ring in rings] == [6, 6]


@pytest.mark.parametrize("seed", range(5))
def test_faces_stay_a_division_of_the_outline(seed):
    rng = np.random.default_rng(seed)
    lines = [CORNERS[[0, 1, 2, 3, 0]]]
    lines += [np.column_stack([[0.0, 10.0], 0.5 + 5.0 * rng.random(2)]) for _ in range(4)]
    lines += [np.column_stack([0.5 + 9.0 * rng.random(2), [0.0, 6.0]]) for _ in range(4)]
    noded = shapely.union_all([shapely.LineString(line) for line in lines], grid_size=0.001)
    cells = shapely.get_parts(shapely.polygonize([noded]))
    rings = tuple((np.round(shapely.get_coordinates(shapely.normalize(cell))[:-1], 3),) for cell in cells)
    planes = np.column_stack([rng.normal(0.0, 0.05, (len(cells), 2)), np.full(len(cells), 5.0)])
    points, _ = roof(5.0, 5.0)
    points[:, 2] = 5.0 + rng.normal(0.0, 0.1, len(points))
    over = np.full(len(points), -1)
    for k, cell in enumerate(cells):
        over[shapely.contains_xy(cell, points[:, 0], points[:, 1])] = k
    after = contract(points, over, rings, CORNERS, planes)
    polygons = [shapely.Polygon(own[0]) for own in after]
    assert all(one.is_valid for one in polygons)
    assert sum(len(own[0]) for own in after) < sum(len(own[0]) for own in rings)
    assert sum(one.area for one in polygons) == pytest.approx(60.0, abs=0.1)
    assert shapely.union_all(polygons).area == pytest.approx(60.0, abs=0.1)
