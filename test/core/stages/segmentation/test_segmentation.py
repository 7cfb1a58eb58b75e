import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from bench.scenes.buildings import GALLERY, touching_houses
from lidar_buildings.core.model.ids import building_id
from lidar_buildings.core.stages.segmentation.config import AS_PUBLISHED, SegmentationConfig
from lidar_buildings.core.stages.segmentation.segmentation import distinct_ids, segment_buildings
from lidar_buildings.core.stages.segmentation.windows import chain_windows

KEEP_ALL = SegmentationConfig(min_points=1, min_area=0.0)


def pairwise_components(xy, reach):
    """Compare every pair of points: the oracle."""
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


@settings(max_examples=60)
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
    found = segment_buildings(np.array([[0.0, 0, 0], [1e8, 0, 0], [-1e8, 1e8, 0]]), KEEP_ALL)
    assert found.building_id.shape == (3,)


def lattice(x, y, n_columns, n_rows, step=0.5):
    column, row = np.meshgrid(np.arange(n_columns), np.arange(n_rows))
    return np.column_stack(
        (x + step * column.ravel(), y + step * row.ravel(), np.full(column.size, 5.0))
    ).astype(float)


@pytest.mark.parametrize("min_neck", [1.5, 2.5])
def test_a_row_of_single_points_joins_two_buildings_unless_necks_are_cut(min_neck):
    west, east, neck = lattice(0, 0, 16, 16), lattice(15, 0, 16, 16), lattice(8.0, 4.0, 14, 1)
    for points in (np.vstack((west, east, neck)), np.vstack((west, lattice(9.5, 0, 16, 16), neck[1:2]))):
        for deg in (0.0, 27.0):
            turned = turn(points, deg)
            joined = segment_buildings(turned, SegmentationConfig(min_neck=0.0), point_spacing=0.5)
            assert len(joined.patterns) == 1
            cut = segment_buildings(turned, SegmentationConfig(min_neck=min_neck), point_spacing=0.5)
            assert len(cut.patterns) == 2
            assert (cut.building_id > 0).all()
            assert len(np.unique(cut.building_id[:256])) == 1
            # They touch at the neck: one block, named by its western end.
            westernmost = cut.building_id[np.argmin(turned[:, 0])]
            assert (cut.block_id == westernmost).all()
            order = np.random.default_rng(0).permutation(len(turned))
            again = segment_buildings(turned[order], SegmentationConfig(min_neck=min_neck), point_spacing=0.5)
            assert np.array_equal(again.building_id, cut.building_id[order])


@pytest.mark.parametrize("name", ["gable", "l_shape", "courtyard", "round_tower"])
def test_no_roof_is_cut_that_has_no_neck(name):
    scene = GALLERY[name](density=6.0, seed=2)
    found = segment_buildings(scene.points[scene.is_roof])
    assert len(found.patterns) == 1


@pytest.mark.parametrize("kept", [0.6, 1.0])
def test_no_roof_is_cut_where_returns_are_missing_or_strips_overlap(kept):
    rng = np.random.default_rng(1)
    once, twice = lattice(0.0, 0.0, 80, 40, 0.4), lattice(12.0, 0.0, 50, 40, 0.4)
    points = np.concatenate((once, twice))
    points[:, :2] += rng.uniform(-0.2, 0.2, (len(points), 2))
    found = segment_buildings(points[rng.random(len(points)) < kept], point_spacing=0.35)
    assert len(found.patterns) == 1


def turn(points, deg):
    cos, sin = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    return points @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])


def test_a_shed_beside_a_building_is_none_of_it():
    shed = lattice(-2.9, 0, 4, 3)
    found = segment_buildings(np.vstack((lattice(0, 0, 16, 16), shed)), point_spacing=0.5)
    assert (found.building_id[-len(shed) :] == 0).all()


@pytest.mark.parametrize("deg", [0.0, 30.0])
def test_a_building_one_window_wide_is_one(deg):
    for n_rows in (1, 2, 4):
        points = turn(lattice(0, 0, 60, n_rows), deg)
        found = segment_buildings(points, point_spacing=0.5)
        assert len(found.patterns) == 1
        assert (found.building_id > 0).all()


def test_the_published_window_keeps_an_even_scan_together_and_has_no_least_area():
    points = np.vstack((lattice(0, 0, 12, 12), lattice(7.0, 0, 4, 3), lattice(20, 0, 3, 3)))
    found = segment_buildings(points, AS_PUBLISHED, point_spacing=0.5)
    assert len(found.patterns) == 2
    assert (found.building_id[-9:] == 0).all()
    assert AS_PUBLISHED.window == 2.2


def test_the_result_does_not_depend_on_the_points_order_or_on_what_else_is_in_the_tile():
    rng = np.random.default_rng(8)
    near = np.vstack([house(12 * k, 0, seed=k, density=4.0) for k in range(4)])
    near = np.vstack((near, rng.uniform((-5, -5, 5), (50, 15, 6), (40, 3))))
    time, strip = rng.uniform(0, 10, len(near)), rng.integers(1, 3, len(near))
    found = segment_buildings(near, gps_time=time, point_source_id=strip, point_spacing=0.5)
    order = rng.permutation(len(near))
    again = segment_buildings(
        near[order], gps_time=time[order], point_source_id=strip[order], point_spacing=0.5
    )
    assert np.array_equal(again.building_id, found.building_id[order])
    assert again.patterns == found.patterns
    far = house(300, -200, density=20.0)
    more = segment_buildings(np.vstack((far, near)), point_spacing=0.5)
    assert np.array_equal(
        more.building_id[len(far) :], segment_buildings(near, point_spacing=0.5).building_id
    )


@pytest.mark.parametrize("n_points", [1, 2, 3])
def test_clusters_of_few_points_are_none_beside_a_building_or_alone(n_points):
    few = lattice(40, 0, n_points, 1)
    assert not segment_buildings(few).building_id.any()
    found = segment_buildings(np.vstack((lattice(0, 0, 16, 16), few)), point_spacing=0.5)
    assert not found.building_id[-n_points:].any()
    assert not found.block_id[-n_points:].any()


def test_a_building_in_one_strip_has_that_strips_spacing_where_strips_overlap_elsewhere():
    rng = np.random.default_rng(0)
    single, double = lattice(0.0, 0.0, 28, 28, 0.7071), lattice(40.0, 0.0, 56, 56, 0.3536)
    points = np.concatenate((single, double))
    points[:, :2] += rng.normal(0.0, 0.05, (len(points), 2))
    found = segment_buildings(points, point_spacing=0.3536)
    sparse, dense = (found.patterns[int(found.building_id[row])].along for row in (0, -1))
    assert sparse == pytest.approx(2**-0.5, rel=0.1)
    assert dense == 0.3536
