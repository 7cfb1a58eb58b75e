import numpy as np
from support.lattice import lattice

from lidar_buildings.core.stages.ground_filter.landforms import continues_terrain


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
