"""The benchmark of building models, on roofs small enough for a test."""

from itertools import pairwise

import numpy as np
import pytest

from bench.models import city3d, grade_cases, grade_truth, grades, strips
from bench.models import clouds as model_clouds
from bench.models import run as models
from bench.models import truth as model_truth
from bench.scenes.models import model_scene
from lidar_buildings.core.solids.raising import extrude
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.simulation import make_scene


@pytest.fixture(scope="module")
def gable():
    """A gable house with its own verdict."""
    scene = model_scene("gable", rotation_deg=30.0)
    (verdict,) = model_truth.judged([scene])
    return scene, verdict


def test_a_model_is_measured_against_its_truth(gable):
    _, verdict = gable
    assert (verdict.n_faces, verdict.n_found, verdict.n_extra) == (2, 2, 0)
    assert verdict.angle_deg < 1.0
    assert verdict.is_valid
    assert verdict.volume_error < 0.2
    table = model_truth.truth_table([verdict]).splitlines()
    assert [line.split()[0] for line in table[2:]] == ["gable", "all"]


def test_a_plane_that_is_split_or_missed_is_not_found(gable):
    scene, _ = gable
    right = scene.plane_id.copy()
    assert model_truth.matched_planes(right, scene) == {1: 1, 2: 2}
    east = scene.points[:, 0] > np.median(scene.points[:, 0])
    split = np.where((right == 1) & east, 3, right).astype(np.uint16)
    found = model_truth.matched_planes(np.where(split == 2, 0, split).astype(np.uint16), scene)
    assert found[2] == 0


def test_levels_reasons_and_validity_are_counted():
    box = extrude(model_scene("flat").outline, 0.0, 5.0)
    torn = Solid(box.vertices, box.faces[1:], box.semantics[1:])
    buildings = [
        model_clouds.BuiltModel(
            "a", {"2.2": (box,), "1.2": (box,)}, {"status": "ok", "reason": "", "rmse": 0.1}
        ),
        model_clouds.BuiltModel(
            "b", {"1.2": (torn,)}, {"status": "ok", "reason": "the roof at 3.25 m is low"}
        ),
        model_clouds.BuiltModel("c", {}, {"status": "degenerate", "reason": "the roof at 4.5 m is low"}),
    ]
    cloud = model_clouds.CloudModels("town", buildings, None)
    assert [cloud.n_at(level) for level in ("2.2", "1.3", "1.2", "")] == [1, 0, 1, 1]
    assert [(name, level) for name, level, _ in cloud.invalid()] == [("b", "1.2")]
    assert model_clouds.own_rmse(cloud).tolist() == [0.1]
    row = model_clouds.clouds_table([cloud]).splitlines()[2].split()
    assert row[:6] == ["town", "3", "33.33", "0.00", "33.33", "1"]
    reasons = model_clouds.reasons_table([cloud])
    assert "the roof at … m is low" in reasons
    assert "3.25" not in reasons


def test_the_command_compares_roofs_that_are_named(capsys):
    models.main(["--parts", "scenes", "--roofs", "flat", "--rotations", "1", "--density", "2"])
    assert "flat" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="--set: there is no stage 'roofs'"):
        models.main(["--parts", "bad", "--set", "roofs.x=1"])
    assert models.rotations(3) == [0.0, 30.0, 60.0]


def test_what_lies_off_the_truth_or_beside_it_is_measured(gable):
    scene, _ = gable
    truth = grade_truth.truth_of(scene.building)
    assert grade_truth.difference([scene.solid], truth).total == 0.0
    assert grade_truth.difference([], truth) == (1.0, 0.0, 0.0)
    raised = Solid(np.add(scene.solid.vertices, (0.0, 0.0, 0.6)), scene.solid.faces, scene.solid.semantics)
    assert grade_truth.difference([raised], truth) == (0.0, 0.0, 1.0)
    moved = Solid(np.add(scene.solid.vertices, (1.0, 0.0, 0.0)), scene.solid.faces, scene.solid.semantics)
    found = grade_truth.difference([moved], truth)
    assert found.is_off
    assert found.truth_alone == pytest.approx(found.model_alone, abs=0.02)


def test_grades_of_a_disturbed_roof_are_counted():
    roof = grade_cases.virtual_roof("gable", 1)
    cases = [
        case for case in grade_cases.cases_of(roof, 1) if case.kind in ("given plain", "footprint resized")
    ]
    found = [grades.graded(case, PipelineConfig()) for case in cases]
    assert [one.is_off for one in found] == [False, True]
    rows = [line.split()[:4] for line in grades.grade_table(found).splitlines()[2:]]
    assert rows[0] == ["all", "2", "1", str(sum(one.grade.value != "good" for one in found[1:]))]


def test_a_model_through_the_points_is_better_than_one_half_a_metre_below(tmp_path):
    right = extrude(model_scene("flat").outline, 0.0, 5.0)
    low = tmp_path / "low.obj"
    vertices = [f"v {x} {y} {min(z, 4.5)}" for x, y, z in right.vertices]
    low.write_text(
        "\n".join([*vertices, *("f " + " ".join(str(k + 1) for k in face[0]) for face in right.faces)])
    )
    x, y = (
        one.ravel()
        for one in np.mgrid[right.vertices[:, 0].min() : right.vertices[:, 0].max() : 20j, 0:1:20j]
    )
    y = np.interp(y, [0, 1], [right.vertices[:, 1].min(), right.vertices[:, 1].max()])
    cloud = np.column_stack([x, y, np.full(400, 5.0), np.zeros((400, 2)), np.ones(400)])
    place = city3d.place_of("a", cloud, [right], city3d.read_obj(low))
    assert (place.ours, place.theirs, place.n_models) == (1.0, 0.0, 1)
    assert place.planes == (1, 0, 1)


def test_flights_over_a_scene_follow_one_another_in_strips_of_their_own():
    scene = make_scene("single_house", 1)
    flights = list(strips.flights_of(scene, 1, 0.5))
    times = np.concatenate([one.gps_time for one in flights])
    kinds = [set(one.point_source_id.tolist()) for one in flights]
    assert len(flights) == 4
    assert len(set().union(*kinds)) == sum(map(len, kinds))
    for before, after in pairwise(flights):
        assert after.gps_time.min() == pytest.approx(before.gps_time.max() + strips.TURN)
    *_, last = strips.after_each_flight(scene, 1, 0.5)
    assert np.array_equal(last.gps_time, times)
