"""Tiles grow by their neighbourhood: how far, to which sides, also in another process."""

import pickle

import numpy as np
import pytest
from support.cut_surveys import SOUTH, WEST, grown_fully, names, square, survey, tiles_of, two_neighbours

from lidar_buildings.core.model.sides import Sides
from lidar_buildings.io.tiling.tiling import TileSource, TilingConfig


def test_a_tile_waits_for_every_file_that_its_largest_buffer_may_need(tmp_path):
    paths = survey(tmp_path, [square(80, WEST + 100.0 * k, SOUTH, 100.0, k) for k in range(4)])
    config = TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=80.0)
    with TileSource(paths, config) as source, TileSource(paths, config) as patient:
        list(tiles_of(patient))
        for tile in tiles_of(source):
            for early, late in zip(grown_fully(source, tile), grown_fully(patient, tile), strict=True):
                assert names(early) == names(late)


def test_growing_doubles_the_buffer_until_its_cap(tmp_path):
    paths = survey(tmp_path, [square(4000, WEST, SOUTH, 400.0)])
    with TileSource(paths, TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=30.0)) as source:
        tile = max(tiles_of(source), key=len)
        grown = grown_fully(source, tile)
        moved = np.abs([np.subtract(larger.bounds, tile.bounds) for larger in grown])
        west, north, east = 10.0 / 3.0, 20.0 / 3.0, 10.0
        assert moved[:, 0] == pytest.approx([west, 3.0 * west, 7.0 * west, 30.0 - west], abs=1e-4)
        assert moved[:, 3] == pytest.approx([north, 3.0 * north, 30.0 - north, 30.0 - north], abs=1e-4)
        assert moved[:, 2] == pytest.approx([east, 20.0, 20.0, 20.0])
        assert {larger.stamp for larger in grown} == {tile.stamp}
        assert all(names(larger, larger.is_core) == names(tile, tile.is_core) for larger in grown)
        assert source.grown(tile.stamp) is None


def test_a_tile_grows_on_the_sides_that_are_asked_for(tmp_path):
    paths = survey(tmp_path, [square(4000, WEST, SOUTH, 400.0)])
    with TileSource(paths, TilingConfig(tile_size=50.0, buffer=12.0, max_buffer=30.0)) as source:
        tile = max(tiles_of(source), key=len)
        north = source.grown(tile.stamp, Sides(north=True))
        both = source.grown(tile.stamp, Sides(east=True, north=True))
        assert np.subtract(north.bounds, tile.bounds) == pytest.approx([0.0, 0.0, 0.0, 8.0])
        assert np.subtract(both.bounds, tile.bounds) == pytest.approx([0.0, 0.0, 12.0, 22.0])
        assert set(names(tile)) < set(names(north)) < set(names(both))
        assert source.grown(tile.stamp, Sides(north=True)) is None


def test_a_tile_that_was_sent_elsewhere_is_the_same_there(tmp_path):
    paths = survey(tmp_path, [square(4000, WEST, SOUTH, 400.0)])
    with TileSource(paths, TilingConfig(tile_size=50.0, buffer=10.0, max_buffer=30.0)) as source:
        sent = [pickle.loads(pickle.dumps(tile)) for tile in source.ready()]
        for here, there in zip(tiles_of(source), sent, strict=True):
            assert names(here) == names(there.read())
            assert here.point_spacing == there.read().point_spacing
            assert there.grow()
            assert names(source.grown(here.stamp)) == names(there.read())


def test_growing_ends_where_there_are_no_more_points(tmp_path):
    with TileSource(survey(tmp_path, [square(50, WEST, SOUTH, 40.0)])) as source:
        (tile,) = tiles_of(source)
        assert source.grown(tile.stamp) is None


def test_growing_an_unknown_tile_is_a_mistake(tmp_path):
    with (
        TileSource(two_neighbours(tmp_path)) as source,
        pytest.raises(ValueError, match="stamp = 5: must be"),
    ):
        source.grown(5)
