"""A cloud in tiles with buffers gives the ground and the outlines that it gives as a whole."""

import laspy
import numpy as np
import pytest
from support.cloud_files import saved

from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig
from lidar_buildings.pipeline.reconstruct import reconstruct_tile


def whole_result(tile, until="regularisation"):
    """Process a tile, with a larger buffer as long as one of its buildings is not whole."""
    while True:
        result = reconstruct_tile(tile.read(), until=until, is_all=lambda sides: not tile.grow(sides))
        if not result.clipped:
            return result


def outlines_of(paths, tile_size):
    """The regularised rings of every building by id, in the coordinates of the files' reference system."""
    found = {}
    with TileSource(paths, TilingConfig(tile_size=tile_size)) as source:
        origin = np.asarray(source.frame.origin[:2])
        for tile in source.ready():
            for one in whole_result(tile).outlines:
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


def test_a_hall_wider_than_a_tile_and_its_buffer_is_no_ground(tmp_path):
    x, y = np.meshgrid(np.arange(0.75, 300.0, 1.5), np.arange(0.75, 240.0, 1.5))
    hall = (np.abs(x - 150.0) < 90.0) & (np.abs(y - 120.0) < 60.0)
    noise = np.random.default_rng(0).normal(0.0, 0.02, x.shape)
    cloud = laspy.LasData(laspy.LasHeader(point_format=1, version="1.2"))
    cloud.xyz = np.stack([x, y, 9.0 * hall + noise], axis=-1).reshape(-1, 3)
    cloud.return_number[:] = cloud.number_of_returns[:] = 1
    taken = n_core = 0
    config = TilingConfig(tile_size=60.0, buffer=40.0, max_buffer=200.0)
    with TileSource([saved(cloud, tmp_path / "hall.laz")], config) as source:
        for tile in source.ready():
            done = whole_result(tile, "ground_filter").classified
            is_roof = done.points[:, 2] > 5.0 + done.points[:, 2].min()
            taken += int(np.count_nonzero(done.is_core & is_roof & (done.classification == 2)))
            n_core += int(done.is_core.sum())
    assert n_core == x.size
    assert taken < 0.05 * np.count_nonzero(hall)
