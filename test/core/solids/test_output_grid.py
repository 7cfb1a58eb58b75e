"""The grid of written coordinates."""

import numpy as np

from lidar_buildings.core.solids.output_grid import elevation_on_grid, on_grid


def test_one_elevation_is_rounded_as_many_are():
    random = np.random.default_rng(0)
    elevations = np.concatenate([random.uniform(-500.0, 9000.0, 2000), np.arange(-2000, 2000) * 0.0005])
    assert [elevation_on_grid(z) for z in elevations.tolist()] == on_grid(elevations).tolist()
