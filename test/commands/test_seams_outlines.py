"""A cloud in tiles with buffers gives the outlines that it gives as a whole."""

import numpy as np
import pytest

from lidar_buildings.commands.tile_work import whole_result
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig
from lidar_buildings.pipeline.reconstruct import PipelineConfig


def outlines_of(paths, tile_size):
    """The regularised rings of every building by id, in the coordinates of the files' reference system."""
    found = {}
    with TileSource(paths, TilingConfig(tile_size=tile_size)) as source:
        origin = np.asarray(source.frame.origin[:2])
        for tile in source.ready():
            for one in whole_result(tile, PipelineConfig(), "regularisation").outlines:
                assert one.building_id not in found
                found[one.building_id] = [ring + origin for ring in one.outline.rings]
    return found


def assert_same_outlines(found, expected):
    assert found.keys() == expected.keys()
    for building, rings in expected.items():
        assert len(found[building]) == len(rings), building
        for ring, other in zip(found[building], rings, strict=True):
            np.testing.assert_array_equal(ring, other, err_msg=str(building))


@pytest.mark.real_data
@pytest.mark.slow
def test_montpellier_in_six_tiles_has_the_outlines_of_montpellier_as_one(data_folder):
    paths = sorted((data_folder / "montpellier").glob("*.laz"))
    as_one = outlines_of(paths, 1000.0)
    assert len(as_one) >= 8
    assert_same_outlines(outlines_of(paths, 50.0), as_one)
