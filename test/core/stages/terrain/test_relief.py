"""The ground as few triangles: close to all nodes, without cracks between squares, none where unknown."""

from collections import defaultdict

import numpy as np
import pytest
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from lidar_buildings.core.stages.terrain.relief import relief

TOLERANCE = 0.1


def hills(n=129, seed=0):
    """Smooth hills with some roughness, and a step."""
    random = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    rough = random.normal(0.0, 0.02, (n, n))
    return 2.0 * np.sin(x / 19) + np.cos(y / 13) + 1.5 * (x + 2 * y > 170) + rough


def area_of(rows, columns, triangles):
    """The area in plan of all triangles, which must not overlap."""
    x, y = columns[triangles].T, -rows[triangles].T
    return ((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])) / 2


def test_no_node_is_further_off_than_the_tolerance():
    terrain = hills()
    rows, columns, triangles = relief(terrain, TOLERANCE)
    areas = area_of(rows, columns, triangles)
    assert areas.min() > 0
    assert areas.sum() == 128**2
    assert len(rows) < terrain.size / 4
    x, y, z = columns[triangles], -rows[triangles], terrain[rows, columns][triangles]
    for node in np.random.default_rng(1).integers(0, 129, (300, 2)):
        one = np.stack([np.ones_like(x), x, y], axis=2).transpose(0, 2, 1)
        weights = np.linalg.solve(one, np.array([1.0, node[1], -node[0]])[None, :, None])[:, :, 0]
        inside = np.flatnonzero((weights > -1e-9).all(axis=1))
        off = np.abs((weights[inside] * z[inside]).sum(axis=1) - terrain[tuple(node)])
        is_on_side = (node % 128 == 0).any()
        assert len(inside)
        assert off.max() <= TOLERANCE * (2 if is_on_side else 1) + 1e-9


def test_neighbouring_squares_meet():
    whole = hills()
    whole[30:50, 58:70] = np.nan
    sides = []
    for part, column in ((whole[:, :65], 64), (whole[:, 64:], 0)):
        rows, columns, triangles = relief(part, TOLERANCE)
        edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        edges = edges[(columns[edges] == column).all(axis=1)]
        sides.append({tuple(sorted(rows[edge].tolist())) for edge in edges})
    assert sides[0] == sides[1]
    assert len(sides[0]) > 5


def test_unknown_ground_has_no_triangles_and_level_ground_few():
    terrain = np.zeros((65, 65))
    assert len(relief(terrain, TOLERANCE)[2]) == 2
    terrain[20:40, 25:45] = np.nan
    terrain[:, 60:] = np.nan
    rows, columns, triangles = relief(terrain, TOLERANCE)
    assert area_of(rows, columns, triangles).sum() == pytest.approx(64 * 59 - 21 * 21, abs=10)
    assert len(triangles) < 60


@pytest.mark.parametrize("seed", range(3))
def test_triangles_around_a_vertex_hang_together(seed):
    random = np.random.default_rng(seed)
    terrain = hills()
    terrain[ndimage.gaussian_filter(random.normal(size=terrain.shape), 2.0) > 0.1] = np.nan
    _, _, triangles = relief(terrain, TOLERANCE)
    around = defaultdict(list)
    for a, b, c in triangles.tolist():
        for vertex, edge in ((a, (b, c)), (b, (c, a)), (c, (a, b))):
            around[vertex].append(edge)
    for edges in around.values():
        rows, columns = np.array(edges).T
        size = int(max(rows.max(), columns.max())) + 1
        links = sparse.coo_matrix((np.ones(len(rows)), (rows, columns)), (size, size))
        own = np.unique([rows, columns])
        assert len(np.unique(csgraph.connected_components(links)[1][own])) == 1


@pytest.mark.parametrize("n_known", [0, 1, 2, 5])
def test_of_a_row_of_nodes_there_is_no_triangle(n_known):
    terrain = np.full((9, 9), np.nan)
    terrain[4, :n_known] = 1.0
    assert [len(each) for each in relief(terrain, TOLERANCE)] == [0, 0, 0]
