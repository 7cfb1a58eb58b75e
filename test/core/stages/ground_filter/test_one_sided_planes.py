import math

import numpy as np
from support.lattice import lattice

from lidar_buildings.core.stages.ground_filter import landforms
from lidar_buildings.core.stages.ground_filter.landforms import continues_terrain


def continues_by_least_squares(candidates, row, ground):
    """Whether a candidate lies on a plane by least squares through a half plane's ground."""
    around = candidates[ground] - candidates[row]
    around = around[np.hypot(*around[:, :2].T) <= landforms.PLANE_REACH]
    for turn in range(8):
        side = (math.cos(turn * math.pi / 4), math.sin(turn * math.pi / 4))
        those = around[around[:, :2] @ side > 1e-9]
        if len(those) < landforms.MIN_PLANE_POINTS:
            continue
        spread = np.linalg.eigvalsh(np.cov(those[:, :2].T))
        design = np.column_stack((those[:, :2], np.ones(len(those))))
        plane = np.linalg.lstsq(design, those[:, 2], rcond=None)[0]
        residual = np.sqrt(np.mean((design @ plane - those[:, 2]) ** 2))
        if (
            4 * spread[0] * spread[1] > landforms.MIN_SPREAD * spread.sum() ** 2
            and np.hypot(*those[:, :2].T).min() <= landforms.PLANE_NEAREST
            and np.hypot(*plane[:2]) <= landforms.MAX_SLOPE
            and residual <= landforms.MAX_RESIDUAL
            and abs(plane[2]) <= landforms.MAX_DISTANCE + residual
        ):
            return True
    return False


def test_points_continue_the_planes_that_least_squares_fit_to_half_planes():
    candidates = lattice(30.0, 30.0)
    ground = np.random.default_rng(0).random(len(candidates)) < 0.3
    candidates[:, 2] += 0.5 * candidates[:, 0] + np.random.default_rng(1).normal(0, 0.3, len(candidates))
    rows = np.flatnonzero(~ground)
    expected = [continues_by_least_squares(candidates, row, ground) for row in rows]
    np.testing.assert_array_equal(continues_terrain(candidates, rows, ground, 1.0), expected)
    assert 0 < np.sum(expected) < len(rows)


def test_points_continue_the_slope_on_one_side_of_them_and_roofs_do_not():
    candidates = lattice(30.0, 30.0, spacing=1.0, jitter=0.4)
    x, y, z = candidates.T
    z += 0.5 * x
    ground = x < 18.0  # beyond it nothing was found so far
    is_roof = (x > 18.0) & (y > 15.0)
    z[is_roof] += 3.0
    rows = np.flatnonzero((x > 18.0) & (x < 18.8) & (abs(y - 15.0) > 3.0))
    found = continues_terrain(candidates, rows, ground, 1.0)
    assert found[~is_roof[rows]].all()
    assert not found[is_roof[rows]].any()
