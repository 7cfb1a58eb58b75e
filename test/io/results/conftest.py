"""Fixtures of the tests of results."""

import numpy as np
import pytest
from support import cloud_files
from support.cut_surveys import tiles_of

from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig

WEST, SOUTH = 85000.0, 447000.0


@pytest.fixture
def survey(tmp_path):
    """Two files side by side, and their tiles."""
    paths = []
    for number in range(2):
        corner = (WEST + 100.0 * number, SOUTH, 0.0)
        cloud = cloud_files.random_cloud(600, point_format=6 * number + 1, corner=corner, seed=number)
        cloud.withheld = np.zeros(600, dtype=np.uint8)  # else they keep their class
        paths.append(
            cloud_files.saved(
                cloud_files.with_geo_keys(cloud, {1024: 1, 3072: 28992}), tmp_path / f"{number}.las"
            )
        )
    source = TileSource(paths, TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=10.0))
    yield source, list(tiles_of(source))
    source.close()
