"""Points that come to a building after its tile sharpen its model, as sums, in whatever order they come."""

import numpy as np
import pytest

from bench.scenes.models import model_scene
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.solids.validity import check_solid
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.pipeline import live_models
from lidar_buildings.pipeline.live_models import LiveModels, live_roofs
from lidar_buildings.pipeline.tile_models import build_models

HOUSE, STAMP, DENSITY = 7, 5_000_000_000, 2.0


def strip(seed, name="gable"):
    return model_scene(name, density=DENSITY, rotation_deg=20, seed=seed)


def first_roof(name="gable", move=0.0):
    """The live roof of a house that was flown over once, with walls that lie outside of where they are."""
    scene = strip(0, name)
    n = len(scene.points)
    tile = PointTile(
        scene.points,
        stamp=STAMP,
        height_above_ground=scene.points[:, 2] - scene.ground_elevation,
        building_id=np.full(n, HOUSE),
        plane_id=scene.plane_id,
        point_spacing=DENSITY**-0.5,
    )
    outline = Outline.of(scene.outline.polygon.buffer(move, join_style="mitre")).oriented()
    outlines = (BuildingOutline(HOUSE, outline),)
    (roof,) = live_roofs(tile, outlines, build_models(tile, outlines, BuildingModelConfig()))
    return roof


def state(roof):
    return roof._sums.moments.sums.tolist(), roof._gaps.tolist(), roof.n_points


def test_strips_in_portions_and_any_order_are_the_same_sums_as_all_points_at_once():
    points = np.concatenate([strip(seed).points for seed in (1, 2, 3)])
    one, other = first_roof(), first_roof()
    one.add(points)
    for part in np.array_split(np.random.default_rng(0).permutation(points), 7):
        other.add(part)
    assert state(one) == state(other)
    left, right = one.solved(), other.solved()
    assert np.array_equal(left.model.solids["2.2"].vertices, right.model.solids["2.2"].vertices)
    assert left.attributes == right.attributes


@pytest.mark.parametrize("name", ["gable", "hip", "shed", "l_shape"])
def test_errors_and_standard_deviations_fall_with_each_strip(name):
    roof, errors, sigmas = first_roof(name, move=0.15), [], []
    true = strip(0, name).wireframe.corners
    for seed in (1, 2, 3, 4):
        solved = roof.solved()
        vertices = solved.model.solids["2.2"].vertices
        away = np.linalg.norm(true[:, None] - vertices, axis=2).min(axis=1)
        errors.append(np.median(away))
        sigmas.append(solved.attributes["corner_sigma_xy"])
        assert check_solid(solved.model.solids["2.2"]) == ()
        roof.add(strip(seed, name).points)
    assert errors[-1] < 0.5 * errors[0]
    assert sigmas[-1] < 0.75 * sigmas[0]


def test_what_lies_on_no_plane_of_the_roof_is_not_added():
    roof = first_roof()
    above, beside = (strip(1).points + np.array(shift) for shift in ([0.0, 0.0, 0.5], [0.0, 30.0, 0.0]))
    assert roof.add(np.concatenate([above, beside])) == 0


def test_a_model_is_told_anew_when_no_more_points_come_and_until_its_tile_comes_again():
    live, roof, points = LiveModels(), first_roof(), strip(1).points
    live.replace(STAMP, [roof])
    live.add(points[:200])
    assert list(live.solved()) == []
    live.add(points[200:])
    assert list(live.solved()) == []
    ((stamp, told),) = live.solved()
    assert (stamp, told.building_id) == (STAMP, HOUSE)
    assert told.attributes["provisional"] is True
    assert list(live.solved()) == []
    live.add(points)
    live.replace(STAMP + 1, [first_roof()])
    assert [*live.solved(), *live.solved()] == []


def test_tiles_that_came_long_ago_are_forgotten(monkeypatch):
    monkeypatch.setattr(live_models, "_MOST", 1)
    live, points = LiveModels(), strip(1).points
    live.replace(STAMP, [first_roof()])
    live.replace(STAMP + 1_000_000, [])
    live.add(points)
    assert len([*live.solved(), *live.solved()]) == 1
    live.replace(STAMP + 2_000_000, [first_roof(), first_roof()])
    live.add(points)
    assert len([*live.solved(), *live.solved()]) == 2
