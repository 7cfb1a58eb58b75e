"""What holds for every way to tell edges: order, threads, tiles, scale, and points that are no roof."""

import numpy as np
import pytest

from bench.scenes.edges import level_roof, roof_and_truth
from lidar_buildings.core.neighbours import parallel
from lidar_buildings.core.stages.edge_labelling import rims
from lidar_buildings.core.stages.edge_labelling.config import AS_PUBLISHED, EdgeLabellingConfig
from lidar_buildings.core.stages.edge_labelling.labelling import label_edges

CONFIGS = {
    "default": EdgeLabellingConfig(),
    "published": AS_PUBLISHED,
    "eigenvalues": EdgeLabellingConfig(features="eigenvalues"),
    "linearity": EdgeLabellingConfig(features="linearity"),
    "manhattan": EdgeLabellingConfig(distance="manhattan"),
    "mahalanobis": EdgeLabellingConfig(distance="mahalanobis"),
    "discriminant": EdgeLabellingConfig(method="discriminant_analysis"),
    "surface": EdgeLabellingConfig(thinning="surface"),
}
every_config = pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS.keys())
DEGENERATE = {
    "empty": np.zeros((0, 3)),
    "single": np.ones((1, 3)),
    "two": np.array([[0.0, 0, 0], [1, 1, 1]]),
    "identical": np.ones((40, 3)),
    "collinear": np.arange(40.0)[:, None] * [1, 0.5, 0.1],
    "on one spot in plan": np.arange(40.0)[:, None] * [0, 0, 0.1],
    "far apart": np.array([[0.0, 0, 0], [1e7, 0, 0], [0, 1e7, 50]]),
    "lattice without noise": np.stack(np.meshgrid(np.arange(20.0), np.arange(15.0), 3.0), -1).reshape(-1, 3),
}
MEMBERS = ("edge", "linearity", "planarity", "normals", "neighbourhood_radius")


def assert_same(found, expected, rows=slice(None)):
    for member in MEMBERS:
        assert np.array_equal(getattr(found, member), getattr(expected, member)[rows]), member
    assert found.status == expected.status


@every_config
def test_the_order_of_points_does_not_change_a_label(config):
    points, _ = roof_and_truth("l_shape", density=8.0)
    shuffle = np.random.default_rng(0).permutation(len(points))
    assert_same(label_edges(points[shuffle], config), label_edges(points, config), shuffle)


@every_config
@pytest.mark.parametrize("n_threads", [1, 3])
def test_the_number_of_threads_does_not_change_a_label(monkeypatch, config, n_threads):
    points, _ = roof_and_truth("l_shape", density=8.0)
    expected = label_edges(points, config)
    monkeypatch.setattr(rims, "CELLS_A_BLOCK", 7)
    monkeypatch.setattr(parallel.os, "cpu_count", lambda: n_threads)
    assert_same(label_edges(points, config), expected)


@pytest.mark.parametrize("name", ["default", "eigenvalues", "mahalanobis", "discriminant"])
def test_a_roof_that_is_whole_in_two_tiles_has_the_same_labels_in_both(name):
    # As tiles carry them: float32 in the map frame.
    houses = [level_roof((x, x + 12), (3, 14), 9.0 + x / 10, seed=x + 40) for x in (-40, -20, 0, 20, 40)]
    west, both, east = np.vstack(houses[:2]), houses[2], np.vstack(houses[3:])
    tiles = [np.float64(np.float32(np.vstack(parts))) for parts in ([west, both], [both, east])]
    spacing = 0.35
    left, right = (label_edges(tile, CONFIGS[name], point_spacing=spacing) for tile in tiles)
    for member in MEMBERS:
        mine, theirs = getattr(left, member)[len(west) :], getattr(right, member)[: len(both)]
        assert np.array_equal(mine, theirs), member
    assert 0.02 < left.edge[len(west) :].mean() < 0.3


@every_config
def test_moved_roofs_have_the_same_edges(config):
    # Whole cells of the grid at this spacing, exact in binary.
    points = np.round(roof_and_truth("l_shape", density=8.0)[0] * 1024) / 1024
    moved = points + np.array([320.0, -640.0, 64.0])
    edge, again = (label_edges(p, config, point_spacing=0.25).edge for p in (points, moved))
    assert np.array_equal(edge, again)


@every_config
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_roofs_get_valid_labels(name, config):
    points = DEGENERATE[name]
    found = label_edges(points, config)
    assert found.edge.dtype == np.uint8
    assert len(found.edge) == len(found.normals) == len(points)
    assert set(found.edge) <= {0, 1}
    assert found.status in ("ok", "one_cluster", "too_few_points")
    for member in MEMBERS[1:]:
        assert np.isfinite(getattr(found, member)).all()


@pytest.mark.parametrize("name", ["empty", "single", "identical"])
def test_points_at_one_place_have_no_edges_and_are_said_to_be_too_few(name):
    found = label_edges(DEGENERATE[name])
    assert found.status == "too_few_points"
    assert not found.edge.any()


def test_the_edge_of_a_lattice_without_noise_is_its_outer_points():
    points = DEGENERATE["lattice without noise"]
    found = label_edges(points)
    is_outer = np.isin(points[:, 0], (0.0, 19.0)) | np.isin(points[:, 1], (0.0, 14.0))
    assert found.status == "ok"
    assert np.array_equal(found.edge == 1, is_outer)
