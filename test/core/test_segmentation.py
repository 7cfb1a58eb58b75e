import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scenes import GALLERY, touching_houses
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from lidar_buildings.core.building_id import building_id
from lidar_buildings.core.segmentation import SegmentationConfig, segment_buildings
from lidar_buildings.core.segmentation.members import distinct_ids
from lidar_buildings.core.segmentation.windows import chain_windows

KEEP_ALL = SegmentationConfig(min_points=1, min_area=0.0)


def pairwise_components(xy, reach):
    """
    Compare every pair of points: the oracle.

    """
    apart = np.abs(xy[:, None] - xy[None])
    linked = (apart <= np.asarray(reach)).all(axis=2)
    return connected_components(coo_matrix(linked), directed=False)[1]


def partition(labels):
    return {frozenset(np.flatnonzero(labels == label).tolist()) for label in np.unique(labels)}


def house(x, y, seed=0, density=8.0, size=8.0):
    rng = np.random.default_rng(seed)
    n_points = int(density * size**2)
    return np.column_stack([rng.uniform(0, size, (n_points, 2)) + np.array([x, y]), np.full(n_points, 5.0)])


@pytest.mark.parametrize("reach", [(0.5, 0.5), (0.3, 0.9), (2.0, 0.1)])
@pytest.mark.parametrize("seed", range(5))
def test_windows_chain_the_same_points_as_a_comparison_of_all_pairs(reach, seed):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-12, 12, (600, 2))
    component, n_components = chain_windows(xy, reach)
    assert partition(component) == partition(pairwise_components(xy, reach))
    assert n_components == component.max() + 1


@settings(max_examples=60, deadline=None)
@given(arrays(np.int64, st.tuples(st.integers(0, 60), st.just(2)), elements=st.integers(-12, 12)))
def test_windows_chain_the_same_points_on_a_lattice_with_ties(cells):
    # Quarter metres are exact in floating point: distances equal to the reach are met exactly.
    xy = cells * 0.25
    component, n_components = chain_windows(xy, (0.5, 0.5))
    if len(xy):
        assert partition(component) == partition(pairwise_components(xy, (0.5, 0.5)))
    assert n_components == len(np.unique(component))


def test_houses_with_a_wide_gap_are_two_buildings_and_touching_ones_are_one():
    apart = segment_buildings(np.vstack([house(0, 0), house(12, 0, seed=1)])).building_id
    assert len(np.unique(apart)) == 2
    scene = touching_houses()
    touching = segment_buildings(scene.points[scene.is_roof]).building_id
    assert len(np.unique(touching)) == 1


@pytest.mark.parametrize("density", [0.5, 2.0, 8.0, 30.0])
def test_no_roof_is_torn_at_any_density(density):
    for name in ("gable", "l_shape", "courtyard"):
        scene = GALLERY[name](density=density, seed=3)
        roof = scene.points[scene.is_roof]
        found = segment_buildings(roof).building_id
        assert len(np.unique(found[found > 0])) == 1, name
        assert np.count_nonzero(found) >= 0.98 * len(roof), name


def test_small_clusters_are_no_buildings():
    few = house(30, 0, density=1.0, size=2.0)
    found = segment_buildings(np.vstack([house(0, 0), few])).building_id
    assert (found[-len(few) :] == 0).all()
    assert (found[: -len(few)] > 0).all()
    # Many points on a square metre are still a small area.
    dense = house(30, 0, density=200.0, size=1.0)
    found = segment_buildings(np.vstack([house(0, 0), dense])).building_id
    assert (found[-len(dense) :] == 0).all()


def test_ids_name_the_westernmost_point_and_follow_the_points_order():
    points = np.vstack([house(0, 0), house(12, 3, seed=1)])
    found = segment_buildings(points).building_id
    for number in np.unique(found):
        members = points[found == number]
        assert number == building_id(members[np.argmin(members[:, 0])])
    order = np.random.default_rng(0).permutation(len(points))
    assert np.array_equal(segment_buildings(points[order]).building_id, found[order])


def test_two_anchors_in_one_cell_get_different_ids_whatever_their_order():
    anchors = np.array([[1.1, 1.1, 0.0], [1.2, 1.2, 0.0], [1.1, 1.6, 0.0]])
    ids = distinct_ids(anchors)
    assert len(set(ids.tolist())) == 3
    assert ids[0] == building_id(anchors[0])
    assert ids[2] == building_id(anchors[2])
    assert np.array_equal(distinct_ids(anchors[::-1]), ids[::-1])


@pytest.mark.parametrize("n_points", [0, 1, 2, 20])
def test_degenerate_clouds_give_one_label_per_point(n_points):
    points = np.zeros((n_points, 3))
    assert segment_buildings(points).building_id.shape == (n_points,)
    kept = segment_buildings(points, KEEP_ALL).building_id
    assert (kept > 0).all()
    assert len(np.unique(kept)) <= 1


def test_wrong_arguments_are_named():
    with pytest.raises(ValueError, match="points"):
        segment_buildings(np.zeros((3, 2)))
    with pytest.raises(ValueError, match="gps_time"):
        segment_buildings(np.zeros((3, 3)), gps_time=np.zeros(2))
    with pytest.raises(ValueError, match="finite"):
        segment_buildings([[0.0, np.nan, 0.0]])


def test_enormous_coordinates_are_survived():
    found = segment_buildings(np.array([[0.0, 0, 0], [1e9, 0, 0], [-1e9, 1e12, 0]]), KEEP_ALL)
    assert found.building_id.shape == (3,)
