"""Ridges, hips, valleys, step edges and kinds of roofs."""

import numpy as np
import pytest
import shapely

from bench.scenes.models import BAD_SCENES, model_scene
from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.roof_topology.result import HIP, RIDGE, VALLEY
from lidar_buildings.core.stages.roof_topology.topology import find_topology

SPACING = 8.0**-0.5


def topology_of(scene):
    plane_id = scene.plane_id if scene.given_planes is None else scene.given_planes
    return find_topology(scene.points, plane_id, scene.outline, point_spacing=SPACING)


def count(topology):
    kinds = [line.kind for line in topology.intersections]
    return {RIDGE: kinds.count(RIDGE), HIP: kinds.count(HIP), VALLEY: kinds.count(VALLEY)}


def true_lines(scene):
    """Edges in plan at which two faces of the building meet at one height."""
    return [
        np.array(part.coords)
        for k, face in enumerate(scene.building.faces)
        for other in scene.building.faces[:k]
        for part in shapely.get_parts(shapely.intersection(face.polygon, other.polygon))
        if part.geom_type == "LineString"
        and np.allclose(
            face.elevation(np.array(part.coords)), other.elevation(np.array(part.coords)), atol=1e-3
        )
    ]


@pytest.mark.parametrize("rotation_deg", [0, 27, 71])
@pytest.mark.parametrize(
    ("name", "roof_type", "n_lines"),
    [
        ("flat", "flat", (0, 0, 0)),
        ("shed", "shed", (0, 0, 0)),
        ("gable", "gable", (1, 0, 0)),
        ("low_gable", "gable", (1, 0, 0)),
        ("hip", "hip", (1, 4, 0)),
        ("half_hip", "half-hip", (1, 4, 0)),
        ("pyramid", "pyramid", (0, 4, 0)),
        ("l_shape", "L", (2, 0, 2)),
        ("t_shape", "T", (2, 0, 2)),
        ("hipped_l", "L", (2, 5, 1)),
        ("mansard", "complex", (4, 4, 0)),
        ("pitched_courtyard", "complex", (4, 4, 4)),
        ("double_gable", "complex", (2, 0, 1)),
    ],
)
def test_the_lines_and_the_kind_of_every_roof_are_found(name, roof_type, n_lines, rotation_deg):
    scene = model_scene(name, rotation_deg=rotation_deg, seed=rotation_deg)
    topology = topology_of(scene)
    assert topology.roof_type == roof_type
    assert tuple(count(topology).values()) == n_lines
    assert not topology.steps
    found = shapely.MultiLineString([line.segment[:, :2] for line in topology.intersections])
    for line in true_lines(scene):
        assert (
            shapely.hausdorff_distance(
                shapely.LineString(line), shapely.intersection(found, shapely.LineString(line).buffer(0.06))
            )
            < 0.7
        )  # where three planes meet lines end some spacings early: the cells run them on
    for ridge in scene.ridges:
        near = min(
            (line for line in topology.intersections if line.kind == RIDGE),
            key=lambda line: np.abs(line.segment.mean(axis=0) - ridge.mean(axis=0)).max(),
        )
        assert near.segment[:, 2] == pytest.approx(ridge[:, 2], abs=0.02)


def test_hips_run_from_the_outline_s_corners_to_the_ends_of_the_ridge():
    scene = model_scene("hip", rotation_deg=27)
    topology = topology_of(scene)
    (ridge,) = (line.segment for line in topology.intersections if line.kind == RIDGE)
    for hip in (line.segment for line in topology.intersections if line.kind == HIP):
        gaps = [np.hypot(*(scene.outline.exterior - end[:2]).T).min() for end in hip]
        foot, top = hip[int(np.argmin(gaps))], hip[int(np.argmax(gaps))]
        assert min(gaps) < 1e-3
        assert foot[2] < top[2]
        assert np.linalg.norm(ridge - top, axis=1).min() < 0.7


def test_all_faces_of_a_spire_end_in_its_point():
    topology = topology_of(model_scene("pointed_tower", rotation_deg=27, seed=27))
    tops = [line.segment[np.argmax(line.segment[:, 2])] for line in topology.intersections]
    assert len(tops) == 24
    assert np.ptp(tops, axis=0).max() < 1e-6


@pytest.mark.parametrize("rotation_deg", [0, 27])
def test_a_step_is_one_straight_edge_from_wall_to_wall(rotation_deg):
    scene = model_scene("step", rotation_deg=rotation_deg)
    (step,) = topology_of(scene).steps
    assert step.height == pytest.approx((3.5, 3.5), abs=0.02)
    low, high = (face.polygon for face in scene.building.faces)
    wall = shapely.intersection(low, high)
    assert shapely.hausdorff_distance(shapely.LineString(step.segment), wall) < 0.15
    assert (step.upper, step.lower) == (2, 1)


def test_a_dormer_has_three_steps_that_close_with_its_valley():
    scene = model_scene("dormer", rotation_deg=27, seed=2)
    topology = topology_of(scene)
    assert topology.roof_type == "gable"
    assert len(topology.steps) == 3
    (valley,) = (line.segment for line in topology.intersections if line.kind == VALLEY)
    corners = np.concatenate([valley[:, :2], *(step.segment for step in topology.steps)])
    truth = scene.building.faces[2].rings[0]
    assert np.hypot(*(corners[:, None] - truth).transpose(2, 0, 1)).min(axis=1).max() < 0.3
    sides = [step for step in topology.steps if min(step.height) < 0.2]
    assert len(sides) == 2
    assert all(max(step.height) > 1.8 for step in sides)


@pytest.mark.parametrize("gap", [0.0, 0.3, 0.6, 0.9])
def test_a_step_that_continues_a_wall_lies_on_its_line_wherever_points_begin(gap):
    low, high = shapely.box(0, 0, 12, 6), shapely.box(0, 6, 7, 12)
    xy = np.stack(np.meshgrid(*[np.arange(0.225, 12.0, 0.25)] * 2), axis=-1).reshape(-1, 2)
    upper = shapely.contains_xy(high, *xy.T) | shapely.contains_xy(shapely.box(0, 0, 7, 6), *xy.T)
    lower = shapely.contains_xy(low, *xy.T) & ~upper
    points = np.column_stack([xy, np.where(upper, 9.0, 4.0)])
    outline = Outline(np.array([(0, 0), (12, 0), (12, 6), (7, 6), (7, 12), (0, 12.0)]))
    inside = upper | (lower & (xy[:, 0] > 7.0 + gap))
    topology = find_topology(points[inside], (upper + 2 * lower)[inside], outline)
    (step,) = topology.steps
    assert sorted(step.segment.round(9).tolist()) == [[7.0, 0.0], [7.0, 6.0]]


def test_a_step_far_from_the_centre_turns_with_its_wall_and_keeps_its_ends():
    slope = np.tan(np.radians(1.5))
    ring = np.array([(0, 0), (8, 0), (8, 54), (20, 54 + 12 * slope), (20, 62), (0, 62.0)])
    outline = Outline(ring)
    xy = np.stack(np.meshgrid(np.arange(0.125, 20.0, 0.25), np.arange(0.125, 62.0, 0.25)), axis=-1)
    xy = xy.reshape(-1, 2)
    xy = xy[shapely.contains_xy(outline.polygon, *xy.T)]
    upper = xy[:, 1] > 54 + (xy[:, 0] - 8) * slope
    points = np.column_stack([xy, np.where(upper, 9.0, 4.0)])
    (step,) = find_topology(points, upper + 1, outline).steps
    ends = np.array(sorted(step.segment.tolist()))
    assert ends == pytest.approx(np.array([(0.0, 54 - 8 * slope), (8.0, 54.0)]), abs=1e-6)


def test_the_line_of_two_planes_is_found_over_a_gap_without_points():
    scene = model_scene("gable")
    east = scene.select((scene.points[:, 0] < 44) & (np.abs(scene.points[:, 1] - 30) > 1.0))
    (ridge,) = topology_of(east).intersections
    assert np.sort(ridge.segment[:, 0]) == pytest.approx([33.0, 47.0], abs=0.05)
    assert ridge.segment[:, 2] == pytest.approx(scene.ridges[0, :, 2], abs=0.05)


def test_planes_that_are_one_have_no_border():
    topology = topology_of(BAD_SCENES["coincident_planes"]())
    assert len(topology.planes) == 10
    assert not topology.intersections
    assert not topology.steps
    assert topology.roof_type == "flat"


@pytest.mark.parametrize("name", BAD_SCENES)
def test_hard_scenes_give_a_topology(name):
    scene = BAD_SCENES[name](rotation_deg=12)
    topology = topology_of(scene)
    for line in topology.intersections:
        for number in (line.first, line.second):
            plane = topology.planes[number - 1]
            assert plane.elevation(line.segment[:, :2]) == pytest.approx(line.segment[:, 2], abs=1e-6)


def test_the_order_of_points_does_not_matter():
    scene = model_scene("dormer", rotation_deg=27)
    order = np.random.default_rng(1).permutation(len(scene.points))
    one, other = topology_of(scene), topology_of(scene.select(order))
    for mine, theirs in zip(
        [*one.intersections, *one.steps], [*other.intersections, *other.steps], strict=True
    ):
        assert np.array_equal(mine.segment, theirs.segment)


def vertical():
    random = np.random.default_rng(3)
    wall = random.random((200, 3)) * (0.01, 10, 10)
    roof = random.random((200, 3)) * (10, 10, 0.01) + (0, 0, 10)
    return np.concatenate([wall, roof]), np.repeat([1, 2], 200)


def parallel():
    random = np.random.default_rng(3)
    points = random.random((400, 3)) * (10, 10, 0)
    upper = points[:, 0] > 5
    points[:, 2] = 0.5 * points[:, 1] + 0.5 * upper
    return points, 1 + upper


@pytest.mark.parametrize(
    ("points", "plane_id"),
    [
        (np.zeros((0, 3)), np.zeros(0, int)),
        (np.zeros((3, 3)), np.ones(3, int)),
        (np.random.default_rng(0).random((50, 3)), np.zeros(50, int)),
        (np.random.default_rng(0).random((50, 3)), np.full(50, 3)),
        (np.random.default_rng(0).random((60, 3)) * 9, np.arange(60) % 20),
        (np.ones((30, 3)), 1 + np.arange(30) % 3),
        (np.column_stack([np.arange(30.0), np.zeros(30), np.zeros(30)]), 1 + np.arange(30) // 15),
        vertical(),
        parallel(),
    ],
)
@pytest.mark.parametrize(
    "ring",
    [
        np.zeros((4, 2)),
        np.array([(0, 0), (9, 0), (9, 9), (0, 9.0)]),
        np.array([(1e5, 0), (1e5 + 1, 0), (1e5, 1.0)]),
    ],
)
def test_degenerate_input_gives_a_topology(points, plane_id, ring):
    topology = find_topology(points, plane_id, Outline(ring))
    assert len(topology.planes) == len({0, *plane_id}) - 1
    assert isinstance(topology.roof_type, str)


def test_parallel_planes_have_a_step_and_no_line():
    topology = find_topology(*parallel(), Outline.of(shapely.box(0, 0, 10, 10)))
    assert not topology.intersections
    (step,) = topology.steps
    assert step.segment[:, 0] == pytest.approx([5.0, 5.0], abs=0.3)
    assert step.height == pytest.approx((0.5, 0.5), abs=1e-3)


@pytest.mark.parametrize("name", ["hipped_l", "pitched_courtyard"])
def test_lines_hit_corners_that_are_rounded_to_millimetres(name):
    scene = model_scene(name, rotation_deg=16, seed=4)
    outline = Outline(scene.outline.exterior.round(3), tuple(hole.round(3) for hole in scene.outline.holes))
    topology = find_topology(scene.points, scene.plane_id, outline, point_spacing=SPACING)
    ends = np.concatenate([line.segment[:, :2] for line in topology.intersections])
    for corner in np.concatenate(outline.rings):
        assert np.hypot(*(ends - corner).T).min() < 1e-6


def test_numbers_of_planes_may_have_gaps_and_very_many_planes_stay_by_themselves():
    scene = model_scene("dormer", seed=3)
    spread = np.array([0, 7, 40_000, 65_535], dtype=np.uint16)
    dense, sparse = (
        find_topology(scene.points, ids, scene.outline) for ids in (scene.plane_id, spread[scene.plane_id])
    )
    for one, other in zip(dense.planes, sparse.planes, strict=True):
        assert np.array_equal(one.normal, other.normal)
    assert [(one.first, one.second, one.kind) for one in sparse.intersections] == [
        (one.first, one.second, one.kind) for one in dense.intersections
    ]
    random = np.random.default_rng(0)
    points, outline = random.random((8000, 3)) * (100, 100, 1), Outline.of(shapely.box(0, 0, 100, 100))
    topology = find_topology(points, 1 + np.arange(8000) // 4, outline)
    assert len(topology.planes) == 2000
