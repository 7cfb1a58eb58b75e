import numpy as np
import pytest
import scenes
import shapely

from lidar_buildings.core import row_blocks
from lidar_buildings.core.edge_labelling import EdgeLabellingConfig, label_edges
from lidar_buildings.core.errors import ParameterError

FEATURES = ("eigenvalues", "linearity_planarity", "linearity")
DEGENERATE = {
    "empty": np.zeros((0, 3)),
    "single": np.ones((1, 3)),
    "two": np.array([[0.0, 0, 0], [1, 1, 1]]),
    "identical": np.ones((40, 3)),
    "collinear": np.arange(40.0)[:, None] * [1, 0.5, 0.1],
    "far apart": np.array([[0.0, 0, 0], [1e7, 0, 0], [0, 1e7, 50]]),
}


def roof_and_truth(name, **sampling):
    """Return roof points and their distance from the outline, in point spacings."""
    scene = getattr(scenes, name)(**sampling)
    points = scene.points[scene.is_roof]
    outline = shapely.union_all([building.polygon.boundary for building in scene.buildings])
    distance = shapely.distance(outline, shapely.points(points[:, :2]))
    return points, distance * np.sqrt(sampling["density"])


def sphere(n=6000):
    k = np.arange(n)
    z, angle = 1 - (2 * k + 1) / n, k * np.pi * (3 - np.sqrt(5))
    r = np.sqrt(1 - z * z)
    return 20 * np.column_stack([r * np.cos(angle), r * np.sin(angle), z])


@pytest.mark.parametrize("features", FEATURES)
@pytest.mark.parametrize("density", [2.0, 8.0, 30.0])
def test_edges_are_found_and_surfaces_left_alone(features, density):
    points, distance = roof_and_truth("hip", density=density, rotation_deg=25)
    found = label_edges(points, EdgeLabellingConfig(features=features))
    assert found.status == "ok"
    # The paper's lowest values: 61 % of the edges and 92 % of the rest.
    assert found.edge[distance < 0.35].mean() > 0.8
    assert found.edge[distance > 2].mean() < 0.08


def test_the_outline_of_a_flat_roof_is_found_almost_completely():
    points, distance = roof_and_truth("flat", density=8.0)
    found = label_edges(points)
    assert found.edge[distance < 0.35].mean() > 0.9
    assert found.edge[distance > 2].mean() < 0.03


def test_the_edge_cluster_is_the_more_linear_one():
    points, _ = roof_and_truth("l_shape", density=8.0)
    found = label_edges(points)
    edge = found.edge == 1
    assert found.linearity[edge].mean() > found.linearity[~edge].mean() + 0.2
    assert found.planarity[edge].mean() < found.planarity[~edge].mean()


def test_normals_are_those_of_the_roof_planes():
    scene = scenes.gable(density=8.0)
    points, (building,) = scene.points[scene.is_roof], scene.buildings
    found = label_edges(points)
    slopes = np.array(building.planes)[scene.roof_plane[scene.is_roof] - 1]
    expected = np.column_stack([-slopes[:, 0], -slopes[:, 1], np.ones(len(slopes))])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    cosine = np.sum(found.normals * expected, axis=1)[found.edge == 0]
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean() < 4


def test_a_surface_without_edges_is_not_split_at_random():
    found = label_edges(sphere())
    assert found.status == "one_cluster"
    assert not found.edge.any()


def test_points_on_a_line_are_all_edges():
    found = label_edges(DEGENERATE["collinear"])
    assert found.status == "one_cluster"
    assert found.edge.all()


@pytest.mark.parametrize("features", FEATURES)
def test_the_order_of_points_does_not_change_a_label(features):
    points, _ = roof_and_truth("l_shape", density=8.0)
    shuffle = np.random.default_rng(0).permutation(len(points))
    config = EdgeLabellingConfig(features=features)
    straight, shuffled = label_edges(points, config), label_edges(points[shuffle], config)
    assert np.array_equal(straight.edge[shuffle], shuffled.edge)
    assert np.array_equal(straight.linearity[shuffle], shuffled.linearity)
    assert np.array_equal(straight.normals[shuffle], shuffled.normals)


@pytest.mark.parametrize("n_threads", [1, 3])
def test_the_number_of_threads_does_not_change_a_label(monkeypatch, n_threads):
    points, _ = roof_and_truth("l_shape", density=8.0)
    expected = label_edges(points)
    monkeypatch.setattr(row_blocks, "BLOCK", 100)
    monkeypatch.setattr(row_blocks.os, "cpu_count", lambda: n_threads)
    found = label_edges(points)
    assert np.array_equal(found.edge, expected.edge)
    assert np.array_equal(found.planarity, expected.planarity)


def test_a_scaled_roof_has_the_same_edges():
    # A power of two changes no bit but the exponents.
    points, _ = roof_and_truth("l_shape", density=8.0)
    assert np.array_equal(label_edges(points * 4).edge, label_edges(points).edge)


@pytest.mark.parametrize("name", DEGENERATE)
@pytest.mark.parametrize("features", FEATURES)
def test_degenerate_roofs_get_valid_labels(name, features):
    points = DEGENERATE[name]
    found = label_edges(points, EdgeLabellingConfig(features=features))
    assert found.edge.dtype == np.uint8
    assert len(found.edge) == len(found.normals) == len(points)
    assert set(found.edge) <= {0, 1}
    assert found.status in ("ok", "one_cluster", "too_few_points")
    for values in (found.linearity, found.planarity, found.normals, found.neighbourhood_radius):
        assert np.isfinite(values).all()


def test_points_that_are_no_numbers_are_refused_by_name():
    with pytest.raises(ValueError, match="points"):
        label_edges([[0, 0, np.nan]])


def test_an_unknown_feature_set_is_refused():
    with pytest.raises(ParameterError, match=r"edge_labelling\.features"):
        EdgeLabellingConfig(features="colour")
