"""What speaks against a model: nothing against a good one; each disturbance has its reason."""

import numpy as np
import pytest
import shapely

from bench.scenes.models import GROUND, model_scene
from lidar_buildings.core.model.grade import causes_in
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.plane_fitting.fitting import fit_roof_planes
from lidar_buildings.pipeline.tile_models import build_models

RANDOM = np.random.default_rng(1)


def graded(points, outline, is_traced=False):
    """The grade and the codes of the model of roof points."""
    planes = fit_roof_planes(points)
    model = build_model(
        points, outline, plane_id=planes.plane_id, ground_elevation=GROUND, is_traced=is_traced
    )
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
    raised = scene.points + np.array([0.0, 0.0, 2.0]) * (np.abs(along(scene.points) - 0.5) < 0.1)[:, None]
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


def test_a_roof_most_of_which_has_no_points_is_poor():
    scene = model_scene("gable")
    grades = [graded(scene.points[along(scene.points) < kept], scene.outline) for kept in (0.6, 0.3)]
    assert grades == [("good", []), ("poor", ["no_points"])]


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


def test_ground_that_was_seen_on_a_footprint_is_told():
    scene = model_scene("gable")
    low, high = scene.outline.exterior.min(axis=0) - 4.0, scene.outline.exterior.max(axis=0) + 4.0
    xy = RANDOM.uniform(low, high, (int(8 * np.prod(high - low)), 2))
    xy = xy[~shapely.contains_xy(scene.outline.polygon, *xy.T)]
    points = np.concatenate([scene.points, np.column_stack([xy, np.full(len(xy), GROUND)])])
    wing = shapely.box(*(scene.outline.polygon.centroid.coords[0]), *high)
    for outline, expected in ((scene.outline.polygon, False), (scene.outline.polygon | wing, True)):
        is_roof = np.arange(len(points)) < len(scene.points)
        is_own = is_roof & shapely.contains_xy(outline, *points[:, :2].T)
        tile = PointTile(
            points,
            classification=np.where(is_roof, 6, 2).astype(np.uint8),
            building_id=is_own.astype(np.uint32),
            plane_id=is_own.astype(np.uint16),
        )
        outlines = (BuildingOutline(1, Outline.of(outline), GROUND),)
        (one,) = build_models(tile, outlines, BuildingModelConfig())
        assert ("on_ground" in causes_in(one.attributes["quality_reasons"])) == expected


def test_an_outline_through_the_outermost_of_few_points_is_sparse():
    scene = model_scene("flat", density=1.0)
    hull = Outline.of(shapely.convex_hull(shapely.multipoints(scene.points[:, :2])))
    assert graded(scene.points, hull, is_traced=True) == ("check", ["sparse"])
    assert graded(scene.points, hull) == ("good", [])


def test_a_model_that_is_not_there_is_poor():
    assert graded(np.empty((0, 3)), Outline(np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0]])))[0] == "poor"
