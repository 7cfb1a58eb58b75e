import numpy as np
import pytest

from bench.scenes.buildings import GALLERY, touching_houses
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.segmentation import steps
from lidar_buildings.core.stages.segmentation.config import SegmentationConfig
from lidar_buildings.core.stages.segmentation.segmentation import segment_buildings
from lidar_buildings.pipeline.tile_tracing import trace_buildings

SPLIT = SegmentationConfig(split_at_steps=True)


def plane(west, south, east, north, elevation, *, slope=(0.0, 0.0), density=8.0, noise=0.03, seed=0):
    """Points on a rectangle; `elevation` is that of its south-western corner."""
    rng = np.random.default_rng(seed)
    n_points = int(density * (east - west) * (north - south))
    xy = rng.uniform((west, south), (east, north), (n_points, 2))
    z = elevation + (xy - (west, south)) @ np.array(slope) + rng.normal(0, noise, n_points)
    return np.column_stack((xy, z))


def turned(points, deg):
    cos, sin = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    return points @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])


def agreement(found, truth):
    """Share of points whose building is the one that most of their true building have."""
    right = sum(np.unique(found[truth == k], return_counts=True)[1].max() for k in np.unique(truth))
    return right / len(truth)


@pytest.mark.parametrize("rotation_deg", [0.0, 25.0, 70.0])
@pytest.mark.parametrize("density", [2.0, 8.0, 25.0])
def test_touching_houses_of_different_heights_are_split(density, rotation_deg):
    scene = touching_houses(density=density, rotation_deg=rotation_deg)
    roof, truth = scene.points[scene.is_roof], scene.building[scene.is_roof]
    whole = segment_buildings(roof)
    assert len(whole.patterns) == 1
    assert np.array_equal(whole.block_id, whole.building_id)
    split = segment_buildings(roof, SPLIT)
    assert len(split.patterns) == 2
    assert agreement(split.building_id, truth) > 0.99
    assert np.array_equal(split.block_id, whole.building_id)
    assert set(np.unique(split.block_id)) < set(np.unique(split.building_id))
    assert set(split.patterns) == set(np.unique(split.building_id).tolist())


@pytest.mark.parametrize("name", ["gable", "hip", "shed", "dormer", "l_shape", "courtyard", "round_tower"])
@pytest.mark.parametrize("density", [1.0, 8.0])
def test_one_house_stays_one(name, density):
    scene = GALLERY[name](density=density, rotation_deg=20.0)
    found = segment_buildings(scene.points[scene.is_roof], SPLIT)
    assert len(found.patterns) == 1


@pytest.mark.parametrize("slope", [1.0, 1.7])
def test_steep_roofs_are_not_steps(slope):
    for density in (2.0, 10.0):
        west = plane(0, 0, 5, 12, 5.0, slope=(slope, 0.0), density=density)
        east = plane(5, 0, 10, 12, 5.0 + 5 * slope, slope=(-slope, 0.0), density=density, seed=1)
        assert len(segment_buildings(np.vstack((west, east)), SPLIT).patterns) == 1


def test_only_steps_as_high_as_asked_for_split():
    low, high = plane(0, 0, 10, 10, 5.0), plane(10, 0, 20, 10, 6.5, seed=1)
    points = np.vstack((low, high))
    for height, n_buildings in ((1.0, 2), (2.0, 1)):
        config = SegmentationConfig(split_at_steps=True, min_step_height=height)
        assert len(segment_buildings(points, config).patterns) == n_buildings


def test_chimneys_dormers_and_penthouses_stay_with_their_house_and_towers_do_not():
    roof = plane(0, 0, 30, 30, 8.0)
    for size, n_buildings in ((1.0, 1), (3.0, 1), (8.0, 1), (14.0, 2)):
        inside = ((roof[:, :2] > 8) & (roof[:, :2] < 8 + size)).all(axis=1)
        raised = roof + np.where(inside, 4.0, 0.0)[:, None] * np.array([0.0, 0.0, 1.0])
        for deg in (0.0, 33.0):
            found = segment_buildings(turned(raised, deg), SPLIT)
            assert len(found.patterns) == n_buildings, size
            assert (found.building_id > 0).all()


def test_points_of_the_wall_between_do_not_join_two_houses():
    rng = np.random.default_rng(5)
    wall = np.column_stack((rng.uniform(9.95, 10.05, 60), rng.uniform(0, 10, 60), rng.uniform(5, 12, 60)))
    points = np.vstack((plane(0, 0, 10, 10, 5.0), plane(10, 0, 20, 10, 12.0, seed=1), wall))
    found = segment_buildings(points, SPLIT)
    assert len(found.patterns) == 2
    assert (found.building_id > 0).all()


def test_points_half_way_up_a_towers_wall_do_not_go_to_a_roof_of_their_height_across_the_yard():
    rng = np.random.default_rng(5)
    podium = plane(0, 0, 60, 30, 5.0)
    podium = podium[~((podium[:, 0] < 14) | ((podium[:, 0] > 26) & (podium[:, 0] < 40)))]
    tower, other = plane(0, 0, 14, 30, 95.0, seed=1), plane(26, 0, 40, 30, 50.0, seed=2)
    wall = np.column_stack((rng.uniform(13.95, 14.05, 60), rng.uniform(1, 29, 60), rng.uniform(40, 60, 60)))
    points = np.vstack((podium, tower, other, wall))
    found = segment_buildings(points, SPLIT)
    across = np.unique(found.building_id[np.abs(points[:, 0] - 33.0) < 4.0])
    assert len(across) == 1
    assert not (found.building_id[-len(wall) :] == across).any()


def test_a_row_of_many_houses_keeps_every_house_and_does_not_depend_on_the_points_order():
    heights = [5.0, 8.0, 6.5, 10.0, 5.0]
    parts = [plane(6 * k, 0, 6 * k + 6, 11, z, seed=k) for k, z in enumerate(heights)]
    points = turned(np.vstack(parts), 40.0)
    truth = np.repeat(np.arange(5), [len(part) for part in parts])
    found = segment_buildings(points, SPLIT)
    assert len(found.patterns) == 5
    assert agreement(found.building_id, truth) > 0.99
    assert len(np.unique(found.block_id)) == 1
    order = np.random.default_rng(0).permutation(len(points))
    again = segment_buildings(points[order], SPLIT)
    assert np.array_equal(again.building_id, found.building_id[order])
    assert np.array_equal(again.block_id, found.block_id[order])


def test_a_narrow_ledge_goes_to_the_house_with_the_longest_border():
    ledge = plane(0, 10, 10, 11.5, 5.0, seed=2)
    points = np.vstack((plane(0, 0, 10, 10, 8.0), ledge, plane(10, 0, 20, 11.5, 12.0, seed=1)))
    found = segment_buildings(points, SPLIT).building_id
    n_first = len(points) - len(ledge) - 920
    assert len(np.unique(found)) == 2
    assert (found[n_first : n_first + len(ledge)] == found[0]).mean() > 0.95


@pytest.mark.parametrize("n_points", [0, 1, 2, 3, 30])
def test_degenerate_clouds_are_not_split(n_points):
    keep_all = SegmentationConfig(min_points=1, min_area=0.0, split_at_steps=True)
    column = np.arange(n_points) * 0.3
    for points in (np.zeros((n_points, 3)), np.column_stack((column, column, column))):
        found = segment_buildings(points, keep_all)
        assert found.building_id.shape == (n_points,)
        assert (found.building_id > 0).all()
        assert len(found.patterns) == min(n_points, 1)
        assert len(segment_buildings(points, SPLIT).patterns) <= 1


def test_parts_merge_the_smallest_first_and_never_across_blocks():
    points = np.vstack(
        [plane(0, 0, 10, 10, 5.0), plane(10, 0, 11, 10, 8.0, seed=1), plane(11, 0, 30, 10, 5.0, seed=2)]
    )
    part = np.repeat([0, 1, 2], [800, 80, 1520])
    borders = steps.measure_borders(points, part, 3, 1.0)
    area, sums = np.array([100.0, 10.0, 190.0]), steps.plan_sums(points, part, 3)
    limits = {"min_area": 6.0, "min_width": 2.5}
    assert borders.shared[0, 1] == pytest.approx(10.0, rel=0.3)
    for block, expected in (([0, 0, 0], [0, 2, 2]), ([0, 0, 1], [0, 0, 2]), ([0, 1, 2], [0, 1, 2])):
        assert steps.merge_parts(borders, area, sums, np.array(block), **limits).tolist() == expected


def test_a_block_of_split_houses_comes_out_whole_in_the_tile_that_holds_its_anchor():
    points = np.vstack([plane(10 * k, 0, 10 * k + 10, 10, 5.0 + 3 * k, seed=k) for k in range(3)])
    west = points[:, 0] < 14.0
    ids = []
    for is_buffer in (~west, west):
        tile = PointTile(points, buffer=is_buffer.astype(np.uint8))
        traced = trace_buildings(tile, SPLIT, BoundaryTracingConfig())
        ids.append([one.building_id for one in traced.outlines])
        assert np.array_equal(
            np.unique(traced.tile.building_id[traced.tile.building_id > 0]), sorted(ids[-1])
        )
    assert [len(one) for one in ids] == [3, 0]


def test_buildings_on_both_ends_of_a_neck_come_out_of_the_same_tile():
    neck = np.column_stack([np.arange(10.3, 15.0, 0.4), np.full(12, 5.0), np.full(12, 5.0)])
    points = np.vstack([plane(0, 0, 10, 10, 5.0), neck, plane(15, 0, 25, 10, 5.0, seed=1)])
    config = SegmentationConfig(min_neck=2.5)
    west = points[:, 0] < 12.5
    counts = []
    for is_buffer in (~west, west):
        tile = PointTile(points, buffer=is_buffer.astype(np.uint8))
        counts.append(len(trace_buildings(tile, config, BoundaryTracingConfig()).outlines))
    assert counts == [2, 0]


def test_borders_are_those_of_a_comparison_of_all_cells():
    rng = np.random.default_rng(4)
    cells = np.argwhere(rng.random((9, 7)) < 0.7)
    part = rng.integers(0, 3, len(cells))
    # A point of a part that owns no cell lies amid the owner of its cell, which has two.
    cells, part = np.vstack((cells, cells[:1], cells[:1])), np.append(part, [part[0], 3])
    points = np.column_stack((cells + 0.5, np.zeros(len(cells))))
    owner = {tuple(cell): int(one) for cell, one in zip(cells[::-1].tolist(), part[::-1], strict=True)}
    shared, free = {(3, int(part[0])): 1, (int(part[0]), 3): 1}, np.zeros(4)
    for (x, y), own in owner.items():
        for right, up in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            two = ((x + far * right, y + far * up) for far in (1, 2))
            beside = next((owner[cell] for cell in two if cell in owner), None)
            if beside is None:
                free[own] += 1
            elif beside != own:
                shared[own, beside] = shared.get((own, beside), 0) + 1
    found = steps.measure_borders(points, part, 4, 1.0)
    assert np.allclose(found.free * 1.27, free)
    assert {pair: round(length * 1.27, 6) for pair, length in found.shared.items()} == shared


@pytest.mark.parametrize("deg", [0.0, 30.0, 45.0, 110.0])
@pytest.mark.parametrize("width", [1.2, 3.0, 8.0])
def test_a_rectangle_has_its_width_however_it_is_turned(width, deg):
    points = turned(plane(1000, -500, 1012, -500 + width, 0.0), deg)
    sums = steps.plan_sums(points, np.zeros(len(points), dtype=np.int64), 1)
    assert steps.spread_width(sums[0]) == pytest.approx(width, rel=0.06)


def test_two_halves_are_as_wide_as_the_whole_and_rectangles_have_the_shorter_side():
    points = turned(plane(0, 0, 12, 6, 0.0), 20.0)
    half = (points[:, 0] > 5.0).astype(np.int64)
    whole = steps.plan_sums(points, np.zeros(len(points), dtype=np.int64), 1)[0]
    assert steps.spread_width(steps.plan_sums(points, half, 2).sum(axis=0)) == pytest.approx(
        steps.spread_width(whole)
    )
    assert steps.rectangle_width(24.0, 20.0) == pytest.approx(4.0)
    assert steps.rectangle_width(25.0, 19.0) == pytest.approx(5.0)


@pytest.mark.parametrize("n_points", [0, 1, 2])
def test_a_few_points_have_no_width(n_points):
    points = np.arange(3.0 * n_points).reshape(n_points, 3)
    sums = steps.plan_sums(points, np.zeros(n_points, dtype=np.int64), 1)
    assert steps.spread_width(sums[0]) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("deg", [0.0, 25.0, 45.0])
def test_a_low_canopy_along_a_wall_is_no_building_of_its_own(deg):
    points = np.vstack((plane(0, 0, 30, 15, 9.0), plane(5, 15, 13, 16.6, 4.0, seed=1)))
    assert len(segment_buildings(turned(points, deg), SPLIT, point_spacing=0.3536).patterns) == 1
