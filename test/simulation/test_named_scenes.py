"""The scenes that can be asked for by name."""

import numpy as np
import pytest
import shapely

from lidar_buildings.simulation import SCENES, make_scene


@pytest.mark.parametrize("name", sorted(set(SCENES) - {"city"}))
@pytest.mark.parametrize("seed", [0, 7])
def test_buildings_are_valid_apart_and_inside_the_scene(name, seed):
    check(make_scene(name, seed))


def check(scene):
    assert [building.number for building in scene.buildings] == list(range(1, len(scene.buildings) + 1))
    for building in scene.buildings:
        assert building.polygon.is_valid
        assert building.polygon.area >= 40.0
        assert building.height > 2.5
        assert np.all((building.exterior > 2.0) & (building.exterior < np.array(scene.size) - 2.0))
    polygons = np.array([building.polygon for building in scene.buildings], dtype=object)
    one, other = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    apart = one != other
    assert (shapely.area(shapely.intersection(polygons[one[apart]], polygons[other[apart]])) < 1e-6).all()


def test_the_village_has_every_kind_of_roof_and_a_row_of_touching_houses():
    scene = make_scene("village", 0)
    kinds = {building.roof_type for building in scene.buildings}
    assert len(scene.buildings) == 28
    assert kinds == {
        *("flat", "shed", "gable", "hip", "l_shape", "t_shape", "step", "dormer", "courtyard", "round_tower")
    }
    assert sorted(np.bincount(scene.blocks())[1:])[-2:] == [2, 3]
    assert {obstacle.roof_type for obstacle in scene.obstacles} == {"car", "wall"}


@pytest.mark.slow
def test_a_city_is_64_villages():
    scene = make_scene("city", 0)
    check(scene)
    assert len(scene.buildings) == 64 * 28
    assert len(scene.roads) == 16
    assert min(scene.size) == 8 * 280.0


def test_roof_types_holds_each_shape_once_on_flat_ground():
    scene = make_scene("roof_types")
    assert len(scene.buildings) == 14
    assert len({building.ground_elevation for building in scene.buildings}) == 1


def test_a_dense_block_is_two_blocks_of_eight_houses():
    assert np.bincount(make_scene("dense_block").blocks()).tolist() == [0, 8, 8]


def test_the_same_seed_gives_the_same_scene_and_another_seed_another():
    corners = [
        np.concatenate([b.exterior for b in make_scene("village", seed).buildings[:5]]) for seed in (4, 4, 5)
    ]
    assert np.array_equal(corners[0], corners[1])
    assert not np.array_equal(corners[0], corners[2])
