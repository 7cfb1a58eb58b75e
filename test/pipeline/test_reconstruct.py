"""The chain of one tile: what cuts a building off ends it, unless there is no more of the tile."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.sides import NONE, Sides
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import steady_spacing
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.pipeline import reconstruct
from lidar_buildings.pipeline.config import PipelineConfig


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


@pytest.fixture
def part_of_a_hall():
    """The east of a hall 320 m long, west of which the tile ends."""
    x, y = np.meshgrid(np.arange(0.0, 180.0, 1.5), np.arange(0.0, 400.0, 1.5))
    z = np.where((x <= 90.0) & (y >= 40.0) & (y <= 360.0), 9.0, 0.0)
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    points += np.random.default_rng(0).normal(0.0, 0.02, points.shape)
    return PointTile(points, point_spacing=1.5, bounds=(-1.0, -9.0, 190.0, 409.0))


@pytest.mark.parametrize("until", ["ground_filter", "building_model"])
def test_a_tile_that_cuts_a_wide_roof_off_ends_after_the_ground_filter(part_of_a_hall, until):
    result = reconstruct.reconstruct_tile(part_of_a_hall, until=until)
    assert result.clipped == Sides(west=True)
    assert result.roofs is None
    rest = reconstruct.reconstruct_tile(part_of_a_hall, until=until, is_all=lambda sides: sides.west)
    assert rest.clipped == NONE
    assert (rest.roofs is None) == (until == "ground_filter")


def test_what_is_cut_off_outside_the_core_is_its_neighbours(part_of_a_hall):
    for core, clipped in (((60.0, 120.0), Sides(west=True)), ((100.0, 179.0), NONE)):
        x = part_of_a_hall.points[:, 0]
        tile = replace(part_of_a_hall, buffer=(x < core[0]) | (x > core[1]))
        assert reconstruct.reconstruct_tile(tile, until="ground_filter").clipped == clipped


@pytest.mark.parametrize("n_again", [0, 40_000])
def test_a_house_is_whole_however_often_a_standing_scanner_measured_its_front(n_again):
    """A gable roof seen ever more sparsely to its rear, whose front was measured again and again."""
    random = np.random.default_rng(5)
    x, y = random.uniform((0.0, 0.0), (9.0, 12.0), (60_000, 2)).T
    rays = np.flatnonzero(random.random(len(x)) < np.exp(-y / 4.0))
    rays = np.concatenate([rays, random.choice(rays[y[rays] < 5.0], n_again)])
    roof = np.column_stack([x, y, 7.5 - np.abs(x - 4.5)])[rays]
    ground = np.column_stack([random.uniform(-15.0, 25.0, (40_000, 2)), np.zeros(40_000)])
    truth = shapely.box(0.0, 0.0, 9.0, 12.0)
    points = np.vstack([roof, ground[~shapely.contains_xy(truth, *ground[:, :2].T)]])
    points += random.normal(0.0, 0.01, points.shape)
    result = reconstruct.reconstruct_tile(PointTile(points, point_spacing=steady_spacing(points, None)))
    assert len(result.outlines) == 1
    polygon = shapely.Polygon(result.outlines[0].outline.exterior)
    assert polygon.intersection(truth).area / polygon.union(truth).area > 0.95


def test_a_config_is_made_of_settings_by_stage_and_names_what_it_does_not_know():
    config = PipelineConfig.from_settings({"roof_selection": {"min_height": 2.5}})
    assert config == PipelineConfig(roof_selection=RoofSelectionConfig(min_height=2.5))
    with pytest.raises(ParameterError, match=r"no stage 'roof_selektion' \(did you mean roof_selection\?\)"):
        PipelineConfig.from_settings({"roof_selektion": {}})
    with pytest.raises(
        ParameterError, match=r"no parameter roof_selection\.min_hight \(did you mean min_height"
    ):
        PipelineConfig.from_settings({"roof_selection": {"min_hight": 2.5}})
