import numpy as np
import pytest
from sklearn.cluster import KMeans

from lidar_buildings.core.stages.edge_labelling.clusters import in_second, metric_of, two_means


def points_of(n_features, seed=0):
    """Return features like those of a roof: a large cluster of surfaces and a small, broad one of edges."""
    random = np.random.default_rng(seed)
    surface = random.normal(0.12, 0.07, 4000)
    edge = random.normal(0.6, 0.15, 700)
    linearity = np.clip(np.concatenate([surface, edge]), 0, 1)
    others = [np.clip(0.9 * (1 - linearity) + random.normal(0, 0.06, len(linearity)), 0, 1) for _ in range(2)]
    return np.column_stack([linearity, *others])[:, :n_features], linearity


@pytest.mark.parametrize("n_features", [1, 2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_euclidean_clusters_are_as_good_as_those_of_the_best_of_ten_random_starts(n_features, seed):
    features, linearity = points_of(n_features, seed)
    centres = two_means(features, linearity, "euclidean")
    best = KMeans(n_clusters=2, n_init=10, random_state=0, tol=0).fit(features)
    inertia = np.min(((features[:, None] - centres) ** 2).sum(axis=2), axis=1).sum()
    assert inertia <= best.inertia_ * (1 + 1e-6)
    expected = best.cluster_centers_[np.argsort(best.cluster_centers_[:, 0])]
    assert np.abs(centres - expected).max() < 1e-3


def test_manhattan_centres_are_the_medians_of_their_clusters():
    features, linearity = points_of(2)
    centres = two_means(features, linearity, "manhattan")
    nearest = np.abs(features[:, None] - centres).sum(axis=2).argmin(axis=1)
    for k in range(2):
        assert np.allclose(np.median(features[nearest == k], axis=0), centres[k], atol=1e-4)
    assert np.array_equal(nearest == 1, in_second(features, centres, metric_of(features, "manhattan")))


def test_mahalanobis_does_not_mind_the_features_units():
    features, linearity = points_of(2)
    stretched = features * [1.0, 0.1]
    labels = [
        in_second(each, two_means(each, linearity, "mahalanobis"), metric_of(each, "mahalanobis"))
        for each in (features, stretched)
    ]
    assert np.mean(labels[0] == labels[1]) > 0.999


@pytest.mark.parametrize("distance", ["euclidean", "manhattan", "mahalanobis"])
@pytest.mark.parametrize("n", [1, 2, 50])
def test_points_with_the_same_features_are_one_cluster(distance, n):
    features = np.full((n, 2), 0.4)
    centres = two_means(features, features[:, 0], distance)
    assert np.allclose(centres, 0.4, atol=1e-4)
    assert not in_second(features, centres, metric_of(features, distance)).any()


@pytest.mark.parametrize("distance", ["euclidean", "manhattan", "mahalanobis"])
def test_features_that_are_functions_of_one_another_are_clustered(distance):
    _, linearity = points_of(1)
    features = np.column_stack([linearity, 1 - linearity])
    centres = two_means(features, linearity, distance)
    second = in_second(features, centres, metric_of(features, distance))
    assert 0.1 < second.mean() < 0.2
    assert linearity[second].min() > linearity[~second].max()
