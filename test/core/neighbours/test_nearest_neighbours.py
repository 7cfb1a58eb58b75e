import numpy as np
import pytest
from scipy.spatial import cKDTree

from lidar_buildings.core.neighbours.nearest_neighbours import nth_distances


def clouds():
    """Return positions of many kinds, by name."""
    random = np.random.default_rng(0)
    even = random.uniform(-50, 50, (20_000, 2))
    lattice = np.stack(np.meshgrid(np.arange(80.0), np.arange(50.0) * 0.3), axis=-1).reshape(-1, 2)
    return {
        "even": even,
        "lattice": np.unique(lattice, axis=0),
        "line": np.column_stack([np.zeros(500), np.arange(500.0)]),
        "clumps": (random.normal(0, 0.2, (50, 200, 2)) + random.uniform(-90, 90, (50, 1, 2))).reshape(-1, 2),
        "strays": np.vstack([even[:5000], [[1e7, 1e7], [-1e7, 3.0]]]),
        "few": even[:20],
        "crowded": np.vstack([even[:100], random.uniform(0, 0.01, (3000, 2))]),
    }


@pytest.mark.parametrize("name", clouds())
@pytest.mark.parametrize("step", [1, 7])
@pytest.mark.parametrize("n", [1, 16])
def test_distances_are_those_of_a_tree_to_the_last_bit(name, n, step):
    plan = clouds()[name]
    expected = cKDTree(plan).query(plan[::step], [n + 1])[0].ravel()
    found, reach = nth_distances(plan, step, n)
    near = np.isfinite(found)
    assert np.array_equal(found[near], expected[near])
    assert (expected[~near] > reach).all()
    assert near.mean() > 0.6


def test_neighbours_that_are_not_there_are_infinitely_far():
    plan = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    assert np.isinf(nth_distances(plan, 1, 3)[0]).all()
