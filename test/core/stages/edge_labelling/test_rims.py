import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.edge_labelling.clusters import roofs_in_plan
from lidar_buildings.core.stages.edge_labelling.rims import on_rims
from lidar_buildings.core.surfaces.surface_patches import connected_parts


def cloud(n=3000, seed=0):
    """Return points of a ragged plane with a hole, some of them on top of one another."""
    random = np.random.default_rng(seed)
    points = random.uniform((-30, -10, 5), (30, 10, 6), (n, 3))
    points = points[np.hypot(points[:, 0] - 5, points[:, 1]) > 4]
    return np.vstack([points, points[:50] + np.array([0, 0, 3.0])])


def rims(points, band=None, roof_id=None, *, radius=1.0, reach=0.0, max_step=np.inf):
    cells = sort_by_cell(points, max(2 * radius, reach))
    band = np.ones(len(points), dtype=bool) if band is None else band
    return on_rims(cells, band, roof_id, radius=radius, reach=reach, max_step=max_step)


def touched_by_empty_discs(plan, radius):
    """
    Whether a disc with each point on its rim is empty: its centre is on a circle round the point, of which
    every other point takes an arc; where something is left, it is so at the end of an arc.
    """
    found = np.zeros(len(plan), dtype=bool)
    for i, place in enumerate(plan):
        x, y = (plan - place).T
        distance = np.hypot(x, y)
        near = (distance > 0) & (distance < 2 * radius)
        middle, half = np.arctan2(y[near], x[near]), np.arccos(distance[near] / (2 * radius))
        ends = np.concatenate((middle - half, middle + half))
        apart = np.abs((ends[:, None] - middle + np.pi) % (2 * np.pi) - np.pi)
        found[i] = not near.any() or (apart >= half - 1e-6).all(axis=1).any()
    return found


@pytest.mark.parametrize("radius", [0.4, 0.7, 1.3, 3.0, 8.0])
@pytest.mark.parametrize("digits", [None, 1, 0])
def test_rims_are_the_points_that_an_empty_disc_touches(radius, digits):
    points = cloud(600)
    points = points if digits is None else np.round(points, digits)
    assert np.array_equal(rims(points, radius=radius), touched_by_empty_discs(points[:, :2], radius))


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


@pytest.mark.parametrize("size", [0.3, 1.0, 7.0])
def test_roofs_are_the_connected_cells(size):
    points = cloud(400)
    cells = sort_by_cell(points, size)
    corner = np.floor(cells.points[cells.first[:-1], :2] / size)
    touching = np.abs(corner[:, None] - corner[None]).max(axis=2) <= 1
    expected = connected_components(touching)[1]
    roof = roofs_in_plan(cells)[cells.rows[cells.first[:-1]]]
    assert (
        len(np.unique(roof))
        == len(np.unique(expected))
        == len(np.unique(np.stack([roof, expected]), axis=1).T)
    )
    assert set(roof) == set(range(len(np.unique(roof))))


def test_points_nearer_than_a_cell_are_of_one_roof_and_distant_ones_are_not():
    points = np.vstack([cloud(600) + np.array([x, 0, 0]) for x in (0, 66, 140)])
    roof = roofs_in_plan(sort_by_cell(points, 2.0))
    part = connected_parts(points, 2.0, in_plan=True)
    for number in np.unique(part):
        assert len(np.unique(roof[part == number])) == 1
    assert len(np.unique(roof)) == 3
