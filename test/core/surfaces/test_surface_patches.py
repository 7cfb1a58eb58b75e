import numpy as np
import pytest

from lidar_buildings.core.surfaces.surface_patches import connected_parts, plan_areas, smooth_patches

LATTICE = np.stack(np.meshgrid(np.arange(10.0), np.arange(10.0)), axis=-1).reshape(-1, 2)


def level(z, x=0.0):
    return np.column_stack([LATTICE[:, 0] + x, LATTICE[:, 1], np.full(100, z)])


def upward(points):
    return np.tile([0.0, 0, 1], (len(points), 1))


def test_a_step_parts_two_level_surfaces():
    points = np.vstack([level(0.0), level(0.5, x=10)])
    patch = smooth_patches(points, upward(points), 1.5, max_angle_deg=10, max_offset=0.2)
    assert len(np.unique(patch)) == 2
    assert len(np.unique(patch[:100])) == 1


def test_a_fold_parts_two_slopes():
    points = np.vstack([level(0.0), level(0.0, x=10)])
    points[100:, 2] = points[100:, 0] - 9.5
    normals = upward(points)
    normals[100:] = np.array([-1, 0, 1]) / np.sqrt(2)
    patch = smooth_patches(points, normals, 1.8, max_angle_deg=30, max_offset=2.0)
    assert len(np.unique(patch)) == 2


def test_a_curved_roof_is_one_patch():
    angle = np.linspace(0, np.pi, 60)
    points = np.array([[10 * np.cos(a), y, 10 * np.sin(a)] for a in angle for y in range(5)])
    normals = points * [0.1, 0, 0.1]
    assert not smooth_patches(points, normals, 1.2, max_angle_deg=10, max_offset=0.2).any()


def test_parts_are_those_of_breadth_first_search():
    points = np.random.default_rng(0).uniform(0, 10, (300, 3))
    part = connected_parts(points, 1.0)
    near = np.linalg.norm(points[:, None] - points, axis=2) <= 1.0
    reach = near
    for _ in range(9):
        reach = reach @ reach
    assert np.array_equal(part[:, None] == part, reach)


def test_parts_in_plan_join_what_lies_above():
    points = np.vstack([level(0.0), level(50.0)])
    assert connected_parts(points, 1.0).max() == 1
    assert connected_parts(points, 1.0, in_plan=True).max() == 0


def test_areas_count_occupied_cells_once():
    points = np.vstack([level(0.0), level(1.0)])
    assert plan_areas(points, np.repeat([0, 1], 100), 2.0) == pytest.approx([100, 100])
    assert plan_areas(points, np.zeros(200, dtype=np.int64), 2.0) == pytest.approx([100])


def test_no_points_have_no_parts():
    nothing = np.zeros((0, 3))
    assert len(connected_parts(nothing, 1.0)) == 0
    assert len(smooth_patches(nothing, nothing, 1.0, max_angle_deg=10, max_offset=1)) == 0
    assert len(plan_areas(nothing, np.zeros(0, dtype=np.int64), 1.0)) == 0
