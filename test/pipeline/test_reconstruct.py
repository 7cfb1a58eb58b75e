"""The chain of one tile: what cuts a building off ends it, unless there is no more of the tile."""

import numpy as np
import pytest

from lidar_buildings.core.model.sides import Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.pipeline import reconstruct


@pytest.fixture
def tile():
    """A shed on a lawn; the tile's limit runs along its eastern wall."""
    x, y = np.meshgrid(np.arange(0.0, 40.0, 0.5), np.arange(0.0, 40.0, 0.5))
    z = np.where((x >= 10.0) & (x <= 25.0) & (y >= 10.0) & (y <= 25.0), 6.0, 0.0)
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    points += np.random.default_rng(0).normal(0.0, 0.02, points.shape)
    return PointTile(points, point_spacing=0.5, bounds=(-50.0, -50.0, 25.5, 90.0))


@pytest.fixture
def n_filtered(monkeypatch):
    """How often the ground was filtered."""
    calls, plain = [], reconstruct.filter_ground
    monkeypatch.setattr(reconstruct, "filter_ground", lambda *some: (calls.append(1), plain(*some))[1])
    return lambda: len(calls)


def test_a_tile_that_cuts_a_building_off_ends_after_tracing(tile):
    result = reconstruct.reconstruct_tile(tile)
    assert result.clipped == Sides(east=True)
    assert len(result.traced) == 1
    assert not result.models


def test_where_there_is_no_more_the_chain_goes_on_with_what_is_done(tile, n_filtered):
    result = reconstruct.reconstruct_tile(tile, is_all=lambda sides: sides == Sides(east=True))
    assert not result.clipped
    assert len(result.models) == 1
    assert n_filtered() == 1
