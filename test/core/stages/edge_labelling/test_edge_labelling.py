import numpy as np
import pytest

from bench.scenes.edges import level_roof, roof_and_truth, sphere
from lidar_buildings.core.stages.edge_labelling.config import AS_PUBLISHED, EdgeLabellingConfig
from lidar_buildings.core.stages.edge_labelling.labelling import label_edges

FEATURES = ("eigenvalues", "linearity_planarity", "linearity")


@pytest.mark.parametrize("features", FEATURES)
@pytest.mark.parametrize("density", [2.0, 8.0, 30.0])
def test_edges_are_found_and_surfaces_left_alone_and_as_published_bands_along_edges(features, density):
    points, distance = roof_and_truth("hip", density=density, rotation_deg=25)
    found = label_edges(points, EdgeLabellingConfig(features=features))
    assert found.status == "ok"
    # The paper's lowest values: 61 % of the edges and 92 % of the rest.
    assert found.edge[distance < 0.35].mean() > 0.8
    assert found.edge[distance > 2].mean() < 0.02
    found = label_edges(points, EdgeLabellingConfig(features=features, scope="tile", thinning="none"))
    assert found.edge[distance < 0.35].mean() > 0.75
    assert found.edge[distance > 2].mean() < 0.08


def test_the_outline_of_a_flat_roof_is_found_almost_completely_also_by_discriminant_analysis():
    points, distance = roof_and_truth("flat", density=8.0)
    found = label_edges(points, EdgeLabellingConfig(method="discriminant_analysis"))
    assert found.status == "ok"
    assert found.clusters == ()
    assert found.edge[distance < 0.35].mean() > 0.8
    assert found.edge[distance > 2].mean() < 0.02
    found = label_edges(points)
    assert found.edge[distance < 0.35].mean() > 0.9
    assert found.edge[distance > 1.5].mean() < 0.01


def test_thinned_edges_are_rows_of_points_not_bands():
    points, distance = roof_and_truth("flat", density=8.0)
    band, thin = (label_edges(points, EdgeLabellingConfig(thinning=t)).edge for t in ("none", "outline"))
    assert np.mean(distance[thin == 1]) < 0.75 * np.mean(distance[band == 1])
    assert thin.sum() < 0.8 * band.sum()


def test_a_step_between_roofs_is_an_edge_of_surfaces_and_not_of_the_outline():
    points = np.vstack([level_roof((0, 15), (0, 12), 12.0), level_roof((15, 30), (0, 12), 8.0, seed=1)])
    at_step = (np.abs(points[:, 0] - 15) < 0.3) & (np.abs(points[:, 1] - 6) < 4)
    outline, surface = (
        label_edges(points, EdgeLabellingConfig(thinning=t)).edge for t in ("outline", "surface")
    )
    assert outline[at_step].mean() < 0.05
    assert surface[at_step].mean() > 0.6
    assert surface[outline == 1].mean() > 0.97


def test_a_large_roof_has_its_edges_though_they_are_few_among_noise():
    # Scattered at random: one point in fifty is on the outline, and k-means splits the noise.
    points = np.random.default_rng(0).uniform((0, 0, 9.8), (200, 200, 10.2), (40_000, 3))
    found = label_edges(points)
    inside = np.abs(points[:, :2] - 100).max(axis=1)
    assert found.status == "one_cluster"
    assert found.edge[inside > 99.7].mean() > 0.8
    assert found.edge[inside < 95].mean() < 0.03


def test_each_roof_has_a_status_of_its_own():
    house, few = level_roof((100, 115), (0, 12), 10.0), level_roof((150, 152), (0, 2), 10.0, density=3.0)
    found = label_edges(np.vstack([sphere(), house, few]), point_spacing=0.5)
    status = {one.n_points: one.status for one in found.clusters}
    assert status == {6000: "one_cluster", len(house): "ok", len(few): "too_few_points"}
    assert found.n_roofs == {"one_cluster": 1, "ok": 1, "too_few_points": 1}
    assert found.status == "ok"
    assert not found.edge[:6000].any()
    assert 0.05 < found.edge[6000 : 6000 + len(house)].mean() < 0.2


def test_points_on_a_line_are_all_edges_and_a_surface_without_edges_is_not_split_at_random():
    found = label_edges(np.arange(40.0)[:, None] * [1, 0.5, 0.1])
    assert found.status == "one_cluster"
    assert found.edge.all()
    found = label_edges(sphere())
    assert found.status == "one_cluster"
    assert not found.edge.any()
    assert label_edges(sphere(), AS_PUBLISHED).edge.mean() < 0.002


def test_what_is_no_number_is_refused_by_name():
    with pytest.raises(ValueError, match="points"):
        label_edges([[0, 0, np.nan]])
    with pytest.raises(ValueError, match="point_spacing"):
        label_edges(np.zeros((2, 3)), point_spacing=0.0)
