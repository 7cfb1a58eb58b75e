import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from lidar_buildings.core.neighbours.union_find import flatten, link, numbered, root, sets_of_pairs


def sets_of(n, links):
    """The forest that the links make of n members, flattened; link by link and all at once."""
    parent = np.arange(n)
    for i, j in links:
        link(parent, i, j)
    flatten(parent)
    one, other = np.reshape(links, (-1, 2)).T
    np.testing.assert_array_equal(sets_of_pairs(n, one, other), parent)
    return parent


@pytest.mark.parametrize("n_links", [0, 40, 150, 400, 2000])
@pytest.mark.parametrize("seed", [0, 1])
def test_sets_are_the_connected_components_of_the_links(n_links, seed):
    n = 400
    links = np.random.default_rng(seed).integers(0, n, (n_links, 2))
    parent = sets_of(n, links)
    _, component = connected_components(coo_matrix((np.ones(n_links), links.T), (n, n)), directed=False)
    np.testing.assert_array_equal(parent[:, None] == parent, component[:, None] == component)


def test_a_set_is_named_by_its_lowest_member_whatever_the_order_and_direction_of_links():
    random = np.random.default_rng(3)
    links = random.integers(0, 200, (150, 2))
    expected = sets_of(200, links)
    assert (expected <= np.arange(200)).all()
    np.testing.assert_array_equal(expected[expected], expected)
    for _ in range(5):
        np.testing.assert_array_equal(sets_of(200, random.permutation(links)[:, ::-1]), expected)


def test_links_within_a_set_or_to_oneself_change_nothing():
    once = sets_of(6, [(0, 3), (3, 5), (1, 2)])
    np.testing.assert_array_equal(sets_of(6, [(0, 3), (3, 5), (5, 0), (4, 4), (2, 1), (1, 2)]), once)
    np.testing.assert_array_equal(once, [0, 1, 1, 0, 4, 0])


def test_the_root_is_known_before_the_forest_is_flattened():
    parent = np.arange(1000)
    for i in range(999, 0, -1):
        link(parent, i, i - 1)
    assert root(parent, 999) == 0


def test_nobody_and_one_alone_make_valid_forests():
    assert sets_of(0, []).shape == (0,)
    np.testing.assert_array_equal(sets_of(1, [(0, 0)]), [0])


def test_sets_are_numbered_by_their_lowest_members():
    np.testing.assert_array_equal(numbered(sets_of(6, [(0, 3), (3, 5), (1, 2)])), [0, 1, 1, 0, 2, 0])
    assert numbered(sets_of(0, [])).shape == (0,)
