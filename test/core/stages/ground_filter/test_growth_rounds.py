import numpy as np
import pytest

from lidar_buildings.core.stages.ground_filter import tin_growth
from lidar_buildings.core.stages.ground_filter.tin_growth import GrowthLimits, candidate_score, start_growth
from lidar_buildings.core.surfaces.incremental_delaunay import insert_vertex
from lidar_buildings.core.surfaces.tin import walk

LIMITS = GrowthLimits(np.radians(9.0), 0.5, 1.4)


def started(n=400, seed=0):
    """Hilly ground with blocks on it, a few of its points in the TIN already; elevations repeat."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, 60.0, (n, 3))
    points[:, 2] = 2.0 * np.sin(points[:, 0] / 9.0) + 5.0 * (points[:, 1] % 25.0 > 18.0)
    points[:, 2] = points[:, 2].round(1)
    points = points[np.lexsort(points.T)]
    return points, start_growth(points, rng.random(n) < 0.05, np.array([[0.0, 0.0], [60.0, 60.0]]))


def triangles_of(growth):
    """The triangles in use."""
    return growth.mesh.triangles[: growth.n_triangles]


def grow_plainly(growth, limits, excluded):
    """
    Let candidates join, all that wait asked in every round whether their triangle changed in the last one.
    """
    vertices, triangles, neighbours, n_real, n_start, _ = growth.mesh
    mesh = (vertices, triangles, neighbours)
    for _ in range(tin_growth.EXTENSIONS):
        tin_growth._extend(growth.mesh, growth.n_triangles)
        changed = np.ones(len(triangles), dtype=bool)
        while True:
            best = {}
            for i in np.flatnonzero(~growth.joined & ~excluded & changed[growth.home]):
                p = n_start + i
                growth.home[i] = here = walk(*vertices[p, :2], growth.home[i], *mesh)
                score = candidate_score(p, here, vertices, n_real, n_start, *mesh[1:], tuple(limits))
                if score < best.get(here, (np.inf, 0))[0]:
                    best[here] = (score, i)
            if not best:
                break
            before = triangles.copy()
            for here, (_, i) in sorted(best.items()):
                p = n_start + i
                growth.home[i] = within = walk(*vertices[p, :2], here, *mesh)
                growth.n_triangles = insert_vertex(
                    p, within, growth.n_triangles, vertices, triangles, neighbours
                )
                growth.joined[i] = True
            changed = (triangles != before).any(axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_rounds_that_look_at_what_changed_build_what_rounds_that_ask_everyone_do(seed):
    _, growth = started(seed=seed)
    plain = growth.copy()
    growth.grow(LIMITS)
    grow_plainly(plain, LIMITS, np.zeros_like(plain.joined))
    assert 50 < growth.joined.sum() < len(growth.joined)
    np.testing.assert_array_equal(growth.joined, plain.joined)
    np.testing.assert_array_equal(triangles_of(growth), triangles_of(plain))
    np.testing.assert_array_equal(growth.mesh.vertices, plain.mesh.vertices)


def test_growth_with_wider_limits_goes_on_from_where_it_stopped_and_leaves_the_excluded_out():
    points, growth = started(seed=5)
    growth.grow(LIMITS)
    plain, excluded = growth.copy(), points[:, 0] < 20.0
    wide = LIMITS._replace(angle=0.6, distance=4.0)
    before = growth.joined.copy()
    growth.grow(wide, excluded)
    grow_plainly(plain, wide, excluded[~growth.is_seed])
    assert (growth.joined & ~before).any()
    assert not (growth.joined & ~before & excluded[~growth.is_seed]).any()
    np.testing.assert_array_equal(triangles_of(growth), triangles_of(plain))
