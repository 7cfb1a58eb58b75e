import numpy as np
import pytest

from lidar_buildings.core.neighbours.cell_grid import rows_by_cell, sort_by_cell
from lidar_buildings.core.surfaces.surface_patches import connected_columns, connected_parts, plan_areas
from lidar_buildings.core.surfaces.surface_patches import smooth_patches as of_columns

LATTICE = np.stack(np.meshgrid(np.arange(10.0), np.arange(10.0)), axis=-1).reshape(-1, 2)


def level(z, x=0.0):
    return np.column_stack([LATTICE[:, 0] + x, LATTICE[:, 1], np.full(100, z)])


def upward(points):
    return np.tile([0.0, 0, 1], (len(points), 1))


def smooth_patches(points, normals, radius, **limits):
    """Return the patch of each point, in their order."""
    columns, patch = sort_by_cell(points, np.max(radius) / 2), np.empty(len(points), dtype=np.int64)
    reach = np.broadcast_to(radius, len(points))[columns.rows]
    patch[columns.rows] = of_columns(columns, normals[columns.rows], reach, **limits)
    return patch


def areas(points, labels, cell):
    """Return the areas of two labels."""
    grid = rows_by_cell(points, cell)
    return plan_areas(labels[grid.rows], 2, grid.first, cell)


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


@pytest.mark.parametrize("in_plan", [False, True])
@pytest.mark.parametrize("size", [0.2, 0.5, 0.8, 3.0])
def test_parts_are_those_of_breadth_first_search(in_plan, size):
    points = np.random.default_rng(0).uniform(0, (40, 10, 10), (300, 3))
    columns, part = sort_by_cell(points, size), np.empty(300, dtype=np.int64)
    part[columns.rows] = connected_columns(columns, 1.3, in_plan=in_plan)
    reach = np.linalg.norm((points[:, None] - points)[..., : 2 if in_plan else 3], axis=2) <= 1.3
    for _ in range(9):
        reach = reach @ reach
    assert np.array_equal(part[:, None] == part, reach)
    assert np.array_equal(np.unique(part), np.arange(part.max() + 1))


def test_links_reach_as_far_as_the_farther_reaching_of_two():
    points = np.column_stack([np.arange(3) * 1.5, np.zeros(3), np.zeros(3)])
    reach = np.array([2.0, 1.0, 1.0])
    patch = smooth_patches(points, upward(points), reach, max_angle_deg=10, max_offset=0.2)
    assert patch[0] == patch[1] != patch[2]


def test_parts_in_plan_join_what_lies_above():
    points = np.vstack([level(0.0), level(50.0)])
    assert connected_parts(points, 1.0).max() == 1
    assert connected_parts(points, 1.0, in_plan=True).max() == 0


def test_areas_count_occupied_cells_once():
    points = np.vstack([level(0.0), level(1.0)])
    assert areas(points, np.repeat([0, 1], 100), 2.0) == pytest.approx([100, 100])
    assert areas(points, np.repeat([-1, 1], 100), 2.0) == pytest.approx([0, 100])


def test_no_points_have_no_parts():
    nothing = np.zeros((0, 3))
    assert len(connected_parts(nothing, 1.0)) == 0
    assert len(smooth_patches(nothing, nothing, 1.0, max_angle_deg=10, max_offset=1)) == 0
    assert not areas(nothing, np.zeros(0, dtype=np.int64), 1.0).any()
