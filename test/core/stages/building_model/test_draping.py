"""Models on the terrain: foot, volume, and what is said where the terrain is unknown or above the eaves."""

import numpy as np
import pytest

from bench.scenes import buildings as scenes
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.core.stages.building_model import draping
from lidar_buildings.core.stages.building_model.config import DRAPED, BuildingModelConfig
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.plane_fitting.fitting import fit_roof_planes
from lidar_buildings.core.surfaces.known_ground import KnownGround

ON_TERRAIN = BuildingModelConfig(foot=DRAPED)


def models(slope, **options):
    """Return the outline of a hip house on a slope, its model on level ground, and that on the terrain."""
    scene = scenes.GALLERY["hip"](rotation_deg=20.0)
    points, house = scene.roof_points(), scene.buildings[0]
    ground = np.column_stack([points[:, :2], terrain(points, slope)])
    known = {"plane_id": fit_roof_planes(points).plane_id, "ground_elevation": float(ground[:, 2].min())}
    level = build_model(points, house.outline, **known)
    return (
        house.polygon,
        level,
        build_model(
            points, house.outline, ON_TERRAIN, ground=options.get("ground", KnownGround.at(ground)), **known
        ),
    )


def terrain(plan, slope):
    return scenes.GROUND + slope * (plan[:, 0] - scenes.CENTRE[0])


def test_all_levels_stand_on_the_terrain_and_the_volume_reaches_down_to_it():
    plan, level, draped = models(0.1)
    assert draped.reason == ""
    mean = terrain(np.array(plan.centroid.coords), 0.1)[0]
    for lod, solid in draped.solids.items():
        assert check_solid(solid) == ()
        less = plan.area * (mean - level.attributes["ground_elevation"])
        assert solid.volume == pytest.approx(level.solids[lod].volume - less, abs=0.3)
    assert draped.attributes["volume"] == pytest.approx(draped.solids["2.2"].volume, abs=1e-4)
    others = draped.attributes | {"volume": level.attributes["volume"]}
    assert others == level.attributes


def test_it_is_said_where_the_terrain_rises_above_the_eaves():
    _, _, draped = models(0.8)
    assert "the terrain rises to the roof of LoD1.2, 1.3, 2.2" in draped.reason


def test_without_ground_a_model_stands_level_and_says_so():
    _, level, draped = models(0.1, ground=None)
    assert "not known: it stands level" in draped.reason
    assert draped.attributes == level.attributes


def test_a_solid_that_would_not_be_valid_stands_level_and_the_reason_names_the_codes(monkeypatch):
    monkeypatch.setattr(draping, "check_solid", lambda solid: (306,))
    _, level, draped = models(0.1)
    assert "LoD2.2 stands level: on the terrain it fails checks 306" in draped.reason
    assert draped.attributes == level.attributes


def test_a_solid_that_cannot_be_draped_stands_level_and_says_why(monkeypatch):
    def fail(*_):
        raise RuntimeError("a level broke")

    monkeypatch.setattr(draping, "draped_solid", fail)
    _, level, draped = models(0.1)
    assert "LoD2.2 stands level: RuntimeError('a level broke')" in draped.reason
    assert draped.attributes == level.attributes
