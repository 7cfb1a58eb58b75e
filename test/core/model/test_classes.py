import numpy as np
import pytest

from lidar_buildings.core.model.classes import CLASS_GROUPS, is_of_groups
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.pipeline.tile_stages import filter_ground, select_roof_points

DECIDED_HERE = (0, 1, 2, 3, 4, 5, 6, 8)


def field_with_a_pond(pond_class=9, **others):
    """Return a tile: a field at 10 m, a pond 0.5 m lower, and a bridge deck of class 17 5 m above it."""
    x, y = (each.ravel() for each in np.meshgrid(np.arange(0.0, 60.0, 0.5), np.arange(0.0, 60.0, 0.5)))
    pond = np.hypot(x - 30, y - 30) < 12
    deck = (abs(y - 30) < 3) & (x > 10) & (x < 50)
    points = np.vstack(
        [
            np.column_stack([x, y, np.where(pond, 9.5, 10.0)]),
            np.column_stack([x, y, np.full(len(x), 15.0)])[deck],
        ]
    )
    classes = np.concatenate([np.where(pond, pond_class, 1), np.full(deck.sum(), 17)])
    return PointTile(points, classification=classes, **others)


def classified(tile, **settings):
    return select_roof_points(filter_ground(tile, GroundFilterConfig(**settings)).tile, RoofSelectionConfig())


def test_every_class_is_either_decided_here_or_of_one_group():
    kept = [number for numbers in CLASS_GROUPS.values() for number in numbers]
    assert sorted([*kept, *DECIDED_HERE]) == list(range(256))
    everything = np.arange(256, dtype=np.uint8)
    assert np.flatnonzero(is_of_groups(everything, ("water", "noise"))).tolist() == [7, 9, 18]
    assert not is_of_groups(everything, ()).any()


def test_water_of_the_source_stays_water_and_carries_the_terrain():
    tile = field_with_a_pond()
    result = classified(tile)
    pond = tile.classification == 9
    assert (result.classification[pond] == 9).all()
    # The bank lies across a facet of the terrain.
    offshore = pond & (np.hypot(*(tile.points[:, :2] - 30).T) < 10)
    assert np.abs(result.height_above_ground[offshore]).max() < 0.05
    assert (result.classification[tile.classification == 1] == 2).all()


def test_water_that_is_not_to_be_kept_is_ground():
    tile = field_with_a_pond()
    groups = tuple(name for name in CLASS_GROUPS if name != "water")
    result = classified(tile, kept_classes=groups)
    assert (result.classification[tile.classification == 9] == 2).mean() > 0.9


def test_a_bridge_stays_a_bridge_has_a_height_and_is_no_ground_nor_roof():
    tile = field_with_a_pond()
    result = classified(tile)
    deck = tile.classification == 17
    assert (result.classification[deck] == 17).all()
    assert (result.height_above_ground[deck] > 4.5).all()


def test_noise_of_the_source_has_no_part_in_the_terrain():
    tile = field_with_a_pond()
    clean = filter_ground(tile, GroundFilterConfig()).tile
    # A slab of false points that is far too large for the search for gross errors.
    x, y = (each.ravel() for each in np.meshgrid(np.arange(5.0, 20.0, 0.5), np.arange(5.0, 20.0, 0.5)))
    slab = np.column_stack([x, y, np.full(len(x), 6.0)])
    noisy = PointTile(
        np.vstack([tile.points, slab]),
        classification=np.concatenate([tile.classification, np.full(len(x), 7)]),
    )
    result = filter_ground(noisy, GroundFilterConfig()).tile
    assert (result.classification[len(tile) :] == 7).all()
    same = result.classification[: len(tile)] == clean.classification
    assert same.mean() > 0.999


@pytest.mark.parametrize(("groups", "expected"), [((), 2), (("other",), 255)])
def test_vendors_classes_are_found_anew_unless_they_are_named(groups, expected):
    x, y = (each.ravel() for each in np.meshgrid(np.arange(20.0), np.arange(20.0)))
    tile = PointTile(np.column_stack([x, y, 0 * x]), classification=np.full(len(x), 255))
    result = classified(tile, kept_classes=(*GroundFilterConfig().kept_classes, *groups))
    assert (result.classification == expected).all()
