"""Gross errors among terrain, buildings and trees whose every point is known."""

import numpy as np
import pytest

from bench.scenes.gross_errors import LOW_PATTERNS
from bench.scenes.terrain_site import TerrainScene
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.ground_filter.config import CANDIDATE_SPACING
from lidar_buildings.core.stages.ground_filter.error_layers import _lowest_of_weight, split_into_layers
from lidar_buildings.core.stages.ground_filter.gross_errors import _gather_groups, find_noise

LOW, HIGH = PointClass.LOW_NOISE, PointClass.HIGH_NOISE
SIZE = 70.0

TERRAINS = {
    "flat": lambda x, y: np.zeros_like(x),
    "slope": lambda x, y: 0.4 * x + 0.2 * y,
    "steep": lambda x, y: 0.8 * x,
    "hills": lambda x, y: 5 * np.sin(x / 25) + 4 * np.cos(y / 20),
}


def noise_of(points):
    """Class of each point, in the order given."""
    cloud = sort_by_cell(points, CANDIDATE_SPACING)
    classes = np.empty(len(points), dtype=np.uint8)
    classes[cloud.rows] = find_noise(cloud)
    return classes


def ground(density, terrain="flat", size=SIZE, seed=0):
    """Points scattered over a square of terrain, with 3 cm of noise."""
    random = np.random.default_rng(seed)
    xy = random.uniform(0, size, (int(density * size * size), 2))
    return np.column_stack((xy, TERRAINS[terrain](*xy.T) + random.normal(0, 0.03, len(xy))))


def clump(at, n_points, depth, radius, terrain="flat", seed=0):
    """Points round a place, below the terrain."""
    random = np.random.default_rng(seed)
    xy = at + random.uniform(-radius, radius, (n_points, 2))
    return np.column_stack((xy, TERRAINS[terrain](*xy.T) - depth + random.uniform(-0.2, 0.2, n_points)))


def sunk(points, centre, half, depth):
    """Points of which those in a rectangle lie lower; and which these are."""
    inside = (np.abs(points[:, :2] - centre) < half).all(axis=1)
    points = points.copy()
    points[inside, 2] -= depth
    return points, inside


def test_points_on_top_of_one_another_count_as_one_however_many_they_are():
    surface = ground(15.0)
    below = clump((33.5, 38.5), 200, 5.0, 0.4)
    classes = noise_of(np.vstack((surface, below)))
    assert (classes[len(surface) :] == LOW).all()
    assert not classes[: len(surface)].any()


@pytest.mark.parametrize("terrain", TERRAINS)
@pytest.mark.parametrize("density", [1.0, 15.0])
@pytest.mark.parametrize(("n_points", "depth"), [(1, 3.0), (2, 40.0), (6, 5.0), (20, 8.0), (60, 15.0)])
def test_low_points_are_found_alone_and_in_groups(terrain, density, n_points, depth):
    surface = ground(density, terrain)
    below = clump((33.0, 38.0), n_points, depth, 0.3 * np.sqrt(n_points), terrain)
    classes = noise_of(np.vstack((surface, below)))
    assert (classes[len(surface) :] == LOW).all()
    # A terrain without errors has hardly any: rugged as it is, one in a thousand would be a hole in it.
    assert (classes[: len(surface)] == 0).mean() > 0.999


@pytest.mark.parametrize("density", [1.0, 4.0, 15.0, 40.0])
def test_groups_a_metre_and_a_half_below_level_ground_are_found(density):
    surface = ground(density)
    below = np.vstack([clump((15.0 + 10 * k, 40.0), k, 1.5, 0.2) for k in range(1, 4)])
    classes = noise_of(np.vstack((surface, below)))
    assert (classes[len(surface) :] == LOW).all()


def test_errors_that_lie_below_one_another_are_all_found():
    surface = ground(4.0)
    stack = np.vstack([clump((35.0, 35.0), 8, depth, 1.0, seed=depth) for depth in (4, 9, 17, 30, 60)])
    classes = noise_of(np.vstack((surface, stack)))
    assert (classes[len(surface) :] == LOW).all()
    assert not classes[: len(surface)].any()


def test_a_sheet_below_a_facade_is_found():
    points = ground(8.0)
    house = (np.abs(points[:, :2] - 35.0) < (12.0, 8.0)).all(axis=1)
    points[house, 2] += 9.0
    random = np.random.default_rng(1)
    sheet = np.column_stack((random.uniform((26, 28), (40, 31), (50, 2)), random.uniform(-6, -5.5, 50)))
    classes = noise_of(np.vstack((points, sheet)))
    assert (classes[len(points) :] == LOW).all()
    assert not classes[: len(points)].any()


@pytest.mark.parametrize("terrain", ["flat", "steep"])
@pytest.mark.parametrize("density", [1.0, 15.0])
@pytest.mark.parametrize("pattern", LOW_PATTERNS)
def test_three_in_a_hundred_points_below_the_ground_are_found_and_the_ground_is_kept(
    pattern, density, terrain
):
    surface = ground(density, terrain)
    scene = TerrainScene(surface, np.ones(len(surface), dtype=bool))
    n_errors = int(0.03 * len(surface))
    errors = LOW_PATTERNS[pattern](scene, n_errors, np.random.default_rng(1), (1.5, 30.0))
    classes = noise_of(np.vstack((surface, errors)))
    assert (classes[len(surface) :] == LOW).mean() > 0.95
    assert not classes[: len(surface)].any()


@pytest.mark.parametrize("density", [2.0, 15.0])
def test_the_floor_below_a_roof_of_glass_is_no_error(density):
    points = ground(density, size=120.0)
    roof = np.abs(points[:, :2] - 60.0).max(axis=1) < 45.0
    passes = np.random.default_rng(2).uniform(size=len(points)) < 0.25
    points[roof & ~passes, 2] += 6.0
    assert (noise_of(points)[roof & passes] == 0).mean() > 0.99


@pytest.mark.parametrize("density", [1.0, 4.0, 15.0])
@pytest.mark.parametrize("half", [1.5, 4.0])
def test_a_courtyard_among_houses_is_no_error(density, half):
    points = ground(density)
    block = (np.abs(points[:, :2] - 35.0) < 14.0).all(axis=1)
    points[block, 2] += 15.0
    points, courtyard = sunk(points, (33.0, 37.0), half, 15.0)
    assert not noise_of(points)[courtyard].any()


@pytest.mark.parametrize(("density", "half"), [(1.0, 5.0), (4.0, 1.5), (4.0, 5.0), (15.0, 1.5), (40.0, 5.0)])
@pytest.mark.parametrize("terrain", ["flat", "slope"])
def test_a_pit_is_no_error(density, half, terrain):
    points, _ = sunk(ground(density, terrain), (33.0, 37.0), half, 8.0)
    assert not noise_of(points).any()


def test_a_quarry_a_cutting_and_a_cliff_are_no_errors():
    points = ground(1.0, size=120.0)
    points, _ = sunk(points, (35.0, 40.0), (25.0, 25.0), 20.0)
    points, _ = sunk(points, (80.0, 60.0), (3.0, 70.0), 6.0)
    points[points[:, 0] > 100.0, 2] += 30.0
    assert not noise_of(points).any()


@pytest.mark.parametrize("density", [0.2, 1.0, 15.0])
def test_the_edge_of_the_data_and_gaps_in_them_are_no_errors(density):
    points = ground(density, "steep", size=SIZE if density >= 1 else 200.0)
    away = np.hypot(*(points[:, :2] - 35.0).T)
    points = points[(away > 9.0) & (np.abs(points[:, 1] - 20.0) > 4.0)]
    assert not noise_of(points).any()


def test_ground_seen_through_a_forest_is_no_error():
    points = ground(8.0, "hills", size=150.0)
    random = np.random.default_rng(3)
    stopped = random.uniform(size=len(points)) < 0.97
    points[stopped, 2] += random.uniform(4.0, 22.0, stopped.sum())
    classes = noise_of(points)
    # One pulse in thirty reaches the ground, at places some two metres apart.
    assert (classes[~stopped] == 0).mean() > 0.99


def test_ground_seen_through_gaps_in_wide_roofs_is_no_error():
    points = ground(2.0, size=90.0)
    roof = np.abs(points[:, :2] - 45.0).max(axis=1) < 38.0
    gap = (points[:, 0] % 9.0 < 0.8) & (points[:, 1] % 6.0 < 3.0)
    points[roof & ~gap, 2] += 9.0
    assert (noise_of(points)[roof & gap] == 0).mean() > 0.99


@pytest.mark.parametrize("height", [14.0, 30.0, 60.0])
@pytest.mark.parametrize("n_points", [1, 3])
@pytest.mark.parametrize("terrain", TERRAINS)
def test_birds_are_found(height, n_points, terrain):
    surface = ground(4.0, terrain)
    bird = clump((41.0, 22.0), n_points, -height, 0.3, terrain)
    classes = noise_of(np.vstack((surface, bird)))
    assert (classes[len(surface) :] == HIGH).all()
    assert not classes[: len(surface)].any()


def test_masts_wires_trees_and_towers_are_no_errors():
    random = np.random.default_rng(5)
    points = ground(4.0)
    tower = (np.abs(points[:, :2] - (12.0, 12.0)) < 4.0).all(axis=1)
    points[tower, 2] += 45.0
    mast = np.column_stack((random.uniform(30, 30.4, (12, 2)), np.linspace(2, 55, 12)))
    along = np.arange(0.0, SIZE, 2.0)
    wire = np.column_stack((along, 0.3 * along + 20, 18 + 0.002 * (along - 35) ** 2))
    crown = random.uniform((50, 50, 14), (56, 56, 24), (25, 3))
    objects = np.vstack((mast, wire, crown))
    assert not noise_of(np.vstack((points, objects))).any()


def test_the_order_of_points_does_not_matter():
    surface = ground(4.0, "hills")
    points = np.vstack((surface, clump((20.0, 20.0), 30, 6.0, 1.5, "hills"), [[50.0, 50.0, 45.0]]))
    rows = np.random.default_rng(6).permutation(len(points))
    np.testing.assert_array_equal(noise_of(points[rows]), noise_of(points)[rows])


@pytest.mark.parametrize("n_points", [1, 2, 5])
def test_a_few_points_are_no_errors(n_points):
    assert not noise_of(np.random.default_rng(7).uniform(0, 50, (n_points, 3))).any()


def test_where_nearly_everything_is_an_error_something_is_left():
    random = np.random.default_rng(8)
    surface = ground(0.05)
    below = random.uniform((0, 0, -60), (SIZE, SIZE, -3), (100 * len(surface), 3))
    assert (noise_of(np.vstack((surface, below))) == 0).any()


def test_a_cloud_is_found_and_a_tower_is_none():
    points = ground(4.0)
    tower = (np.abs(points[:, :2] - (15.0, 55.0)) < 10.0).all(axis=1)
    points[tower, 2] += 260.0
    random = np.random.default_rng(4)
    cloud = random.uniform((35, 10, 380), (65, 40, 410), (1500, 3))
    classes = noise_of(np.vstack((points, cloud)))
    # Where a block shows tower and cloud at once there is not enough air between them.
    assert (classes[len(points) :] == HIGH).mean() > 0.95
    assert not classes[: len(points)].any()


def test_a_column_of_many_layers_has_its_own_lowest_point():
    # In twelve layers of one point each none holds an eighth of the column's points.
    tower = np.column_stack((np.full((12, 2), 0.5), 2.0 * np.arange(12.0)))
    beside = np.array([[1.5, 0.5, 50.0]] * 4)
    layers = split_into_layers(sort_by_cell(np.vstack((tower, beside)), 1.0), 1.0)
    lowest = _lowest_of_weight(layers.points, layers.begin, layers.first)
    assert lowest[:, 2].tolist() == [0.0, 50.0]


def test_a_layer_that_rounding_connects_one_way_alone_is_in_one_group():
    # Layer 0 is in a group already, and layer 1 reaches it.
    points = np.array([[0.5, 0.5, 5.0], [1.5, 0.5, 4.0], [2.5, 0.5, -9.0]])
    layers = split_into_layers(sort_by_cell(points, 1.0), 1.0)
    state, group_of = np.zeros(3, dtype=np.uint8), np.array([0, -1, -1])
    members, begins = _gather_groups(layers, np.array([1, 2]), state, group_of)
    assert sorted(members) == [1, 2]
    assert begins[-1] == 2
