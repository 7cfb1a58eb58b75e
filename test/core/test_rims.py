import numpy as np
import pytest

from lidar_buildings.core.alpha_shape import alpha_shape
from lidar_buildings.core.edge_labelling.plan_cells import plan_cells, roofs_in_plan
from lidar_buildings.core.edge_labelling.rims import on_rims
from lidar_buildings.core.surface_patches import connected_parts


def cloud(n=3000, seed=0):
    """Return points of a ragged plane with a hole, some of them on top of one another."""
    random = np.random.default_rng(seed)
    points = random.uniform((-30, -10, 5), (30, 10, 6), (n, 3))
    points = points[np.hypot(points[:, 0] - 5, points[:, 1]) > 4]
    return np.vstack([points, points[:50] + np.array([0, 0, 3.0])])


def rims(points, band=None, roof_id=None, *, radius=1.0, reach=0.0, max_step=np.inf):
    cells = plan_cells(points, max(2 * radius, reach))
    band = np.ones(len(points), dtype=bool) if band is None else band
    return on_rims(cells, band, roof_id, radius=radius, reach=reach, max_step=max_step)


@pytest.mark.parametrize("radius", [0.4, 0.7, 1.3, 3.0, 8.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_rims_are_the_points_on_the_alpha_shape(radius, seed):
    points = cloud(seed=seed)
    assert np.array_equal(rims(points, radius=radius), alpha_shape(points[:, :2], radius).is_boundary)


def test_only_points_near_the_band_are_looked_at():
    points = cloud()
    everywhere = rims(points)
    band = points[:, 0] < 0
    apart = points[:, None, :2] - points[None, band, :2]
    distance = np.sqrt((apart**2).sum(axis=2)).min(axis=1)
    assert np.array_equal(rims(points, band, reach=2.0), everywhere & (distance <= 2.0))
    assert np.array_equal(rims(points, band), everywhere & band)
    assert not rims(points, np.zeros(len(points), dtype=bool), reach=2.0).any()


def test_points_beyond_a_step_are_not_seen():
    points = cloud()
    points[:, 2] = np.where(points[:, 0] < 0, 5.0, 9.0)
    west = points[:, 0] < 0
    found = rims(points, max_step=2.0)
    assert np.array_equal(found[west], rims(points[west]))
    assert np.array_equal(found[~west], rims(points[~west]))


def test_other_roofs_are_not_seen():
    points = cloud()
    roof_id = (points[:, 1] > 0).astype(np.int64) * 9
    found = rims(points, roof_id=roof_id)
    for number in (0, 9):
        mine = roof_id == number
        assert np.array_equal(found[mine], rims(points[mine]))


def test_a_point_alone_is_on_a_rim():
    assert rims(np.zeros((1, 3))).tolist() == [True]
    assert rims(np.zeros((5, 3))).all()
    assert len(rims(np.zeros((0, 3)))) == 0


@pytest.mark.parametrize("size", [0.3, 1.0, 7.0])
def test_cells_have_all_their_neighbours(size):
    points = cloud(400)
    cells = plan_cells(points, size)
    corner = np.floor(cells.points[cells.first[:-1], :2] / size)
    for k, around in enumerate(cells.around):
        expected = set(np.flatnonzero(np.abs(corner - corner[k]).max(axis=1) <= 1))
        assert set(around[around >= 0]) == expected
        assert around[0] == k


def test_points_nearer_than_a_cell_are_of_one_roof_and_distant_ones_are_not():
    points = np.vstack([cloud(600) + np.array([x, 0, 0]) for x in (0, 66, 140)])
    roof = roofs_in_plan(plan_cells(points, 2.0))
    part = connected_parts(points, 2.0, in_plan=True)
    for number in np.unique(part):
        assert len(np.unique(roof[part == number])) == 1
    assert len(np.unique(roof)) == 3
