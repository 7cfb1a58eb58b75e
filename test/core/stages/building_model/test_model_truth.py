"""Models from points and outline alone against exact truth, and what comes of input that is hard or bad."""

import math

import numpy as np
import pytest

from bench.scenes.models import BAD_SCENES, model_scene, roof_words
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.building_model.model import Level, build_model
from lidar_buildings.core.stages.plane_fitting.fitting import fit_roof_planes
from lidar_buildings.evaluation.scores.models import ridge_errors, roof_wireframe


def modelled(scene, order=None, config=None):
    """Build a scene's model, its points in another order if one is given."""
    order = np.arange(len(scene.points)) if order is None else order
    points = scene.points[order]
    plane_id = fit_roof_planes(points).plane_id if scene.given_planes is None else scene.given_planes[order]
    ground = scene.ground_elevation
    return build_model(points, scene.outline, config, plane_id=plane_id, ground_elevation=ground)


@pytest.mark.parametrize("name", ["flat", "shed", "gable", "hip", "l_shape", "t_shape", "pyramid", "step"])
def test_roofs_of_planes_have_the_volume_the_ridges_and_the_vertices_of_the_truth(name):
    scene = model_scene(name, rotation_deg=23.0, seed=1)
    model = modelled(scene)
    solid = model.solids["2.2"]
    assert model.attributes["roof_type"] in roof_words(name)
    assert model.attributes["n_planes"] == len(scene.building.faces)
    assert solid.volume == pytest.approx(scene.volume, rel=0.01)
    assert len(solid.vertices) == len(scene.solid.vertices)
    frame = roof_wireframe([solid])
    assert np.abs(ridge_errors(frame.segments[frame.is_ridge], scene.ridges, 0.5)).max(initial=0.0) <= 0.05


@pytest.mark.parametrize("name", ["dormer", "gable_dormer"])
def test_the_main_roof_is_the_house_without_its_dormer(name):
    scene = model_scene(name, rotation_deg=23.0, seed=1)
    model = modelled(scene, config=BuildingModelConfig(main_roof=True))
    assert sorted(model.solids) == ["1.2", "1.3", "2.0", "2.2"]
    assert check_solid(model.solids["2.0"]) == ()
    width, eave = 11.0, 5.0
    house = 16.0 * width * (eave + width / 4 * math.tan(math.radians(40.0)))
    assert model.solids["2.0"].volume == pytest.approx(house, rel=0.01)
    assert model.attributes["volume"] == pytest.approx(scene.volume, rel=0.01), "of the finest"


@pytest.mark.parametrize("name", ["hip", "step", "mansard", "parapet"])
def test_a_roof_without_superstructures_is_its_main_roof(name):
    model = modelled(model_scene(name, seed=1), config=BuildingModelConfig(main_roof=True))
    assert np.array_equal(model.solids["2.0"].vertices, model.solids["2.2"].vertices)


def test_a_level_that_fails_its_checks_is_left_out_with_the_reason(monkeypatch):
    module = "lidar_buildings.core.stages.building_model.model"
    monkeypatch.setattr(f"{module}.level_22", lambda *_: Level(None, (203, 306)))
    model = modelled(model_scene("dormer"))
    assert sorted(model.solids) == ["1.2", "1.3"]
    assert (model.status, model.attributes["lod"]) == (BuildingStatus.OK, "1.3")
    assert model.reason == "LoD2.2 fails checks 203, 306"
    monkeypatch.setattr(f"{module}.partition_outline", lambda *_: 1 / 0)
    model = modelled(model_scene("dormer"))
    assert (sorted(model.solids), model.attributes["lod"]) == (["1.2"], "1.2")
    assert "the roof could not be divided into faces: ZeroDivisionError" in model.reason


@pytest.mark.parametrize("name", BAD_SCENES)
def test_hard_and_bad_input_gives_valid_solids_of_all_levels_whatever_the_order_of_points(name):
    scene = BAD_SCENES[name](rotation_deg=17.0)
    model = modelled(scene)
    other = modelled(scene, np.random.default_rng(1).permutation(len(scene.points)))
    assert model.status is BuildingStatus.OK
    assert sorted(model.solids) == ["1.2", "1.3", "2.2"]
    assert model.attributes == other.attributes
    for level, solid in model.solids.items():
        assert check_solid(solid) == ()
        assert np.array_equal(solid.vertices, other.solids[level].vertices)
    highest = scene.points[:, 2].max()
    assert model.solids["2.2"].vertices[:, 2].max() <= highest + 1.0
