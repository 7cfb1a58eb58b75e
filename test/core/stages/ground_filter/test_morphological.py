import laspy
import numpy as np
import pytest
from support.lattice import lattice

from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.consensus import opened_ground
from lidar_buildings.evaluation.scores.cells import score_ground

CONFIG = GroundFilterConfig(method="morphological")


def town(slope=0.0, seed=0, size=160.0):
    """Box houses of 8 to 24 m on a plane of the given slope, 2 points/m²; points and which are roof."""
    random = np.random.default_rng(seed)
    points = lattice(size, size, 0.7, seed=seed)
    roof = np.zeros(len(points), dtype=bool)
    points[:, 2] += slope * points[:, 0]
    for centre in random.uniform(15, size - 15, (20, 2)):
        inside = (np.abs(points[:, :2] - centre) < random.uniform(4, 12, 2)).all(axis=1) & ~roof
        points[inside, 2] = points[inside, 2].max(initial=0.0) + random.uniform(3, 9)
        roof |= inside
    return points, roof


@pytest.mark.parametrize("slope", [0.0, 0.1, 0.3])
def test_boxes_on_a_plane_are_told_from_it(slope):
    points, roof = town(slope)
    ground = opened_ground(points, CONFIG)
    assert not ground[roof].any()
    # At the upper edge of the data a disc has nothing above it to rest on: a strip of a slope is lost there.
    inner = points[:, 0] < points[:, 0].max() - 25.0
    assert ground[inner & ~roof].mean() > 0.99


def test_a_steep_hillside_is_ground():
    points = lattice(120.0, 120.0, 0.8)
    points[:, 2] += 0.7 * points[:, 0]
    ground = opened_ground(points, CONFIG)
    assert ground[points[:, 0] < 95.0].mean() > 0.99


def test_a_hill_as_wide_and_high_as_a_hall_is_ground():
    points = lattice(240.0, 240.0, 1.0)
    away = np.hypot(points[:, 0] - 120.0, points[:, 1] - 120.0)
    points[:, 2] += 12.0 * np.exp(-((away / 35.0) ** 2))
    assert opened_ground(points, CONFIG).mean() > 0.99


@pytest.mark.parametrize(
    "points",
    [
        [[1.0, 2.0, 3.0]],
        [[1.0, 2.0, 3.0], [4.0, 5.0, 3.2]],
        np.ones((100, 3)),
        np.column_stack((np.arange(200.0), 3 * np.arange(200.0), np.full(200, 7.0))),
        lattice(40.0, 40.0, 1.0) * [1, 1, 0] + [0, 0, 25.0],
        [[0.0, 0.0, 0.0], [1e6, 1e6, 0.1]],
        [[1e-9 * k, 0.0, 0.0] for k in range(20)],
    ],
    ids=["one", "two", "identical", "collinear", "one roof only", "huge", "tiny"],
)
def test_what_shows_one_even_surface_is_all_ground(points):
    assert opened_ground(np.array(points), CONFIG).all()


def test_a_tile_with_a_buffer_gets_the_labels_of_the_whole():
    # Wider than a block of 512 cells, and cut across its edge.
    points = lattice(700.0, 60.0, 1.0)
    points[:, 2] += 6 * np.sin(points[:, 0] / 40)
    for x in range(20, 700, 45):
        points[(np.abs(points[:, :2] - [x, 30]) < [9, 12]).all(axis=1), 2] += 7.0
    whole = opened_ground(points, CONFIG)
    reach = 2 * CONFIG.opening_radius + 40.0
    for low, high in ((0.0, 350.0), (350.0, 531.0), (531.0, 700.0)):
        core = (points[:, 0] >= low) & (points[:, 0] < high)
        tile = (points[:, 0] >= low - reach) & (points[:, 0] < high + reach)
        cut = np.zeros(len(points), dtype=bool)
        cut[tile] = opened_ground(points[tile], CONFIG)
        assert (cut == whole)[core].mean() > 0.999


def test_objects_are_told_where_points_are_far_apart():
    # A point every 15 m: only the largest discs find two of them.
    points = lattice(1500.0, 1500.0, 15.0)
    object_ = np.hypot(points[:, 0] - 700.0, points[:, 1] - 700.0) < 10.0
    points[object_, 2] += 30.0
    np.testing.assert_array_equal(opened_ground(points, CONFIG), ~object_)


@pytest.mark.real_data
def test_the_isprs_samples_are_labelled_with_few_errors_wherever_the_grid_lies(data_folder):
    errors = []
    for path in sorted((data_folder / "isprs").glob("samp*.laz")):
        las = laspy.read(path)
        points, truth = np.column_stack((las.x, las.y, las.z)), np.asarray(las.classification)
        for shift in ([0.0, 0.0, 0.0], [0.37, 12.71, 0.0]):
            ground = opened_ground(points + shift, CONFIG)
            errors.append(score_ground(np.where(ground, 2, 1), truth).total_error)
    # Measured: 3.5 % in the mean, 8.8 % on the worst sample.
    assert np.mean(errors) < 0.04
    assert max(errors) < 0.1
