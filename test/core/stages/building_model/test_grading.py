"""What speaks against a model: nothing against a good one; each disturbance has its reason."""

import numpy as np
import pytest
import shapely

from bench.scenes.models import GROUND, model_scene
from lidar_buildings.core.model.grade import Cause, causes_in
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.building_model.grading import doubts_of, evidence_of
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.building_model.quality import outline_support
from lidar_buildings.core.stages.building_model.result import RoofFacePatch
from lidar_buildings.core.stages.plane_fitting.fitting import fit_roof_planes
from lidar_buildings.pipeline.tile_models import build_models

RANDOM = np.random.default_rng(1)


def graded(points, outline):
    """The grade and the codes of the model of roof points."""
    planes = fit_roof_planes(points)
    model = build_model(points, outline, plane_id=planes.plane_id, ground_elevation=GROUND)
    return model.attributes["quality"], causes_in(model.attributes["quality_reasons"])


def along(points):
    """Where points lie along x, from 0 to 1."""
    return (points[:, 0] - points[:, 0].min()) / np.ptp(points[:, 0])


@pytest.mark.parametrize("name", ["flat", "gable", "hip", "l_shape", "courtyard"])
@pytest.mark.parametrize("density", [2.0, 16.0])
def test_a_roof_that_was_seen_whole_is_good(name, density):
    scene = model_scene(name, density=density, rotation_deg=20.0)
    assert graded(scene.points, scene.outline) == ("good", [])


def test_small_gaps_and_noise_are_no_reason():
    scene = model_scene("gable", noise=0.15)
    small = np.hypot(*(scene.points[:, :2] - scene.points[:, :2].mean(axis=0)).T) > 1.5
    assert graded(scene.points[small], scene.outline) == ("good", [])


def test_points_that_no_plane_was_found_for_are_off_as_one_surface():
    scene = model_scene("flat")
    raised = scene.points + np.array([0.0, 0.0, 2.0]) * (along(scene.points) > 0.8)[:, None]
    planes = np.ones(len(raised), dtype=np.uint16)
    model = build_model(raised, scene.outline, plane_id=planes, ground_elevation=GROUND)
    assert "off_points" in causes_in(model.attributes["quality_reasons"])


def test_branches_over_a_roof_are_scattered():
    scene = model_scene("flat", density=4.0)
    is_under = along(scene.points) > 0.7
    branches = np.repeat(scene.points[is_under], 3, axis=0)
    branches[:, 2] += RANDOM.uniform(0.0, 4.0, len(branches))
    points = np.concatenate([scene.points, branches])
    model = build_model(
        points, scene.outline, plane_id=np.ones(len(points), dtype=np.uint16), ground_elevation=GROUND
    )
    assert "scattered" in causes_in(model.attributes["quality_reasons"])


def test_large_parts_without_points_are_told_and_are_poor_where_most_is_missing():
    scene = model_scene("gable")
    grades = [graded(scene.points[along(scene.points) < kept], scene.outline) for kept in (0.6, 0.3)]
    assert [grade for grade, _ in grades] == ["check", "poor"]
    assert all(causes == ["no_points"] for _, causes in grades)


@pytest.mark.parametrize("density", [2.0, 16.0])
def test_a_footprint_drawn_too_wide_is_told(density):
    scene = model_scene("hip", density=density)
    wide = Outline.of(scene.outline.polygon.buffer(1.2, join_style="mitre"))
    assert "too_wide" in graded(scene.points, wide)[1]


def test_a_roof_that_goes_on_beside_its_footprint_is_told_and_a_tree_beside_is_not():
    scene = model_scene("gable")
    part = Outline.of(shapely.intersection(scene.outline.polygon, shapely.box(-100.0, -100.0, 41.0, 100.0)))
    tree = scene.points[along(scene.points) > 0.8] + [3.0, 0.0, 0.0]
    tree[:, 2] = RANDOM.uniform(0.0, 3.0, len(tree)) + scene.points[:, 2].max()
    for outline, points, expected in (
        (part, scene.points, ["too_narrow"]),
        (scene.outline, np.concatenate([scene.points, tree]), []),
    ):
        inside = shapely.contains_xy(outline.polygon, *points[:, :2].T)
        tile = PointTile(
            points,
            building_id=inside.astype(np.uint32),
            plane_id=np.where(inside, fit_roof_planes(points).plane_id, 0).astype(np.uint16),
        )
        (one,) = build_models(tile, (BuildingOutline(1, outline, GROUND),), BuildingModelConfig())
        assert causes_in(one.attributes["quality_reasons"]) == expected


def test_an_outline_through_the_outermost_of_few_points_is_sparse():
    scene = model_scene("flat", density=1.0)
    hull = Outline.of(shapely.convex_hull(shapely.multipoints(scene.points[:, :2])))
    assert graded(scene.points, hull) == ("check", ["sparse"])


def test_a_corner_far_above_or_below_all_points_near_is_a_spike():
    square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    points, none = np.column_stack([RANDOM.uniform(0.0, 10.0, (600, 2)), np.full(600, 6.0)]), np.zeros(600)
    support = outline_support(Outline(square), points[:, :2], none < 1.0, none, 0.4)
    for rise, is_spike in ((0.0, False), (0.05, False), (1.0, True), (-1.0, True)):
        face = RoofFacePatch((square,), np.array([rise, 0.0, 6.0 - 5.0 * rise]), np.arange(600))
        evidence = evidence_of([face], points, Outline(square), 0.4, support)
        assert (Cause.SPIKE in {doubt.cause for doubt in doubts_of(evidence)}) == is_spike


def test_a_model_that_is_not_there_is_poor():
    assert graded(np.empty((0, 3)), Outline(np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0]])))[0] == "poor"
