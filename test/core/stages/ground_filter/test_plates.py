"""Halls wider than any window of a filter, and landforms that look like them."""

import numpy as np
import pytest

from lidar_buildings.core.stages.ground_filter.classification import classify_ground
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.consensus import find_plates

CONFIG = GroundFilterConfig()
#: East and north of the area, and of the hall on it, 200 m x 120 m [m].
EAST, NORTH = 450.0, 350.0
HALL = (100.0, 300.0, 100.0, 220.0)


def inside(x, y, box):
    west, east, south, north = box
    return (x > west) & (x < east) & (y > south) & (y < north)


def beyond(x, y):
    """How far a place lies outside the hall, negative inside [m]."""
    return np.maximum(np.abs(x - 200.0) - 100.0, np.abs(y - 160.0) - 60.0)


def raised(height, box=HALL):
    return lambda x, y: np.where(inside(x, y, box), height, 0.0)


def on_a_slope(x, y):
    return np.where(inside(x, y, HALL), 18.6, 0.06 * y)


def with_parapet(x, y):
    return np.where(beyond(x, y) < -2.0, 10.0, np.where(beyond(x, y) < 0.0, 11.0, 0.0))


def of_two_levels(x, y):
    return raised(10.0)(x, y) + raised(6.0, (300.0, 380.0, 100.0, 220.0))(x, y)


def saw_tooth(x, y):
    return np.where(inside(x, y, HALL), 8.0 + 0.3 * (x % 10.0), 0.0)


HALLS = {
    "flat": raised(8.0),
    "on_a_slope": on_a_slope,
    "with_parapet": with_parapet,
    "of_two_levels": of_two_levels,
    "saw_tooth": saw_tooth,
    "cut_by_the_edge": raised(10.0, (-1.0, 150.0, 100.0, 220.0)),
}
LANDFORMS = {
    "embankment": lambda x, y: np.clip(8.0 - beyond(x, y) / 1.5, 0.0, 8.0),
    "quarry": lambda x, y: np.where(beyond(x, y) < 0.0, -12.0, 0.0),
    "cliff": lambda x, y: np.where(y > 160.0 + 10.0 * np.sin(x / 15.0), 15.0, 0.0),
    "terraces": lambda x, y: 4.0 * np.floor(y / 40.0),
    "mesa with a road up": lambda x, y: np.where(
        inside(x, y, (300.0, 340.0, 100.0, 220.0)), 8.0 - (x - 300.0) / 5.0, raised(8.0)(x, y)
    ),
    "terrace cut by the edge": raised(6.0, (-1.0, 200.0, -1.0, 160.0)),
}


def ground_share(surface, density):
    """What of the places that are as high as a roof is ground, and of the others."""
    rng = np.random.default_rng(5)
    x, y = (rng.random((2, int(EAST * NORTH * density))).T * (EAST, NORTH)).T
    z = surface(x, y)
    turn = np.deg2rad(20.0)
    plan = np.column_stack([x, y]) @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    points = np.column_stack([plan, z + rng.normal(0.0, 0.03, len(z))])
    return classify_ground(points, CONFIG).classification == 2, x, y


@pytest.mark.parametrize("density", [1.0, 0.3])
@pytest.mark.parametrize("name", HALLS)
def test_a_hall_of_any_width_is_no_ground(name, density):
    is_ground, x, y = ground_share(HALLS[name], density)
    roof = HALLS[name](x, y) > (0.06 * y + 3.0 if name == "on_a_slope" else 3.0)
    assert roof.sum() > 5000
    assert is_ground[roof].mean() < 0.005
    assert is_ground[~roof].mean() > 0.995


@pytest.mark.parametrize("density", [1.0, 0.3])
def test_a_stair_of_roofs_down_from_a_hall_does_not_make_ground_of_it(density):
    def surface(x, y):
        stair = 2.6 * np.ceil((380.0 - x) / 20.0)  # along a ninth of the hall's rim
        return np.where(inside(x, y, (300.0, 380.0, 120.0, 190.0)), stair, raised(12.0)(x, y))

    is_ground, x, y = ground_share(surface, density)
    assert is_ground[inside(x, y, HALL)].mean() < 0.01  # cells at the rim reach down to the stair
    assert is_ground[surface(x, y) == 0.0].mean() > 0.995


@pytest.mark.parametrize("density", [1.0, 0.3])
@pytest.mark.parametrize("name", LANDFORMS)
def test_what_does_not_fall_all_round_is_ground(name, density):
    assert ground_share(LANDFORMS[name], density)[0].mean() > 0.99


def lattice(east, north, z=0.0):
    x, y = np.meshgrid(np.arange(0.0, east), np.arange(0.0, north))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])


def test_far_points_and_the_order_make_no_difference():
    points = lattice(200.0, 200.0)
    roof = (np.abs(points[:, :2] - 100.0) < 60.0).all(axis=1)
    points[roof, 2] = 7.0
    ground = np.ones(len(points), dtype=bool)
    np.testing.assert_array_equal(find_plates(points, ground, 1.0).on_roof, roof)
    rows = np.random.default_rng(0).permutation(len(points))
    np.testing.assert_array_equal(find_plates(points[rows], ground, 1.0).on_roof, roof[rows])
    strays = np.array([[1e8, -1e8, 0.0], [-3e7, 2e8, 50.0]])
    found = find_plates(np.vstack([points, strays]), np.append(ground, [True, True]), 1.0).on_roof
    np.testing.assert_array_equal(found[:-2], roof)


@pytest.mark.parametrize("height", [4.0, 15.0])
def test_a_hall_of_80_m_is_not_ground_low_or_high(height):
    rng = np.random.default_rng(0)
    points = lattice(200.0, 200.0)
    points += rng.uniform(0.0, 0.8, points.shape) * (1.0, 1.0, 0.0) + rng.normal(
        0.0, (0.0, 0.0, 0.02), points.shape
    )
    hall = (np.abs(points[:, :2] - [103.0, 97.0]) < [40.0, 40.0]).all(axis=1)
    points[hall, 2] += height
    np.testing.assert_array_equal(classify_ground(points, CONFIG).classification == 2, ~hall)


def test_trees_along_a_wall_hide_no_step():
    points = lattice(200.0, 200.0)
    away = np.abs(points[:, :2] - 100.0).max(axis=1)
    points[away < 60.0, 2] = 7.0
    trees = (away >= 60.0) & (away < 68.0) & (points[:, 1] < 100.0)
    points[trees, 2] = np.random.default_rng(1).uniform(1.0, 7.0, trees.sum())
    np.testing.assert_array_equal(find_plates(points, ~trees, 1.0).on_roof, away < 60.0)


def shown(points, west, east, south, north):
    return points[inside(points[:, 0], points[:, 1], (west, east, south, north))]


def test_a_hall_that_too_little_is_seen_of_asks_for_more():
    points = lattice(300.0, 300.0)
    points[inside(points[:, 0], points[:, 1], (50.5, 250.5, 50.5, 250.5)), 2] = 9.0
    corner = shown(points, -1.0, 150.5, -1.0, 150.5)
    plates = find_plates(corner, np.ones(len(corner), dtype=bool), 1.0)
    assert not plates.on_roof.any()
    np.testing.assert_array_equal(plates.cut_off, [[[50.0, 50.0], [152.0, 152.0]]])
    most = shown(points, -1.0, 301.0, -1.0, 220.5)
    plates = find_plates(most, np.ones(len(most), dtype=bool), 1.0)
    np.testing.assert_array_equal(plates.on_roof, most[:, 2] > 5.0)
    assert not len(plates.cut_off)


@pytest.mark.parametrize(
    ("surface", "n_asking"),
    [
        (lambda x, _: 0.3 * x, 0),
        (lambda x, y: -6.0 * inside(x, y, (60.0, 90.0, 100.0, 130.0)), 0),
        (lambda x, _: 6.0 * np.floor(x / 50.0), 1),
    ],
    ids=["slope", "around a pit", "the highest of three terraces"],
)
def test_of_terrain_only_what_falls_on_all_sides_that_are_seen_asks(surface, n_asking):
    points = lattice(150.0, 250.0)
    points[:, 2] = surface(points[:, 0], points[:, 1])
    assert len(find_plates(points, np.ones(len(points), dtype=bool), 1.0).cut_off) == n_asking


@pytest.mark.parametrize("points", [lattice(1.0, 1.0), lattice(30.0, 30.0, 9.0), lattice(50.0, 1.0)])
def test_the_lowest_surface_is_never_raised(points):
    plates = find_plates(points, np.ones(len(points), dtype=bool), 1.0)
    assert not plates.on_roof.any()
    assert not len(plates.cut_off)
