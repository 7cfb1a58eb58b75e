import numpy as np
import pytest

from lidar_buildings.core.neighbours.neighbourhoods import build_grid, neighbours_of


def cloud(n=400, seed=0, side=6.0, offset=0.0):
    return np.random.default_rng(seed).uniform(-side / 2, side / 2, (n, 3)) + offset


def neighbours(points, radius, in_plan=False):
    """Return the input rows within a radius of every point."""
    grid = build_grid(points, radius)
    near = np.empty(len(grid.points), dtype=np.int64)
    found = [None] * len(near)
    for i, (x, y, z) in enumerate(grid.points):
        count = neighbours_of(grid, grid.cell[i], x, y, z, radius, in_plan, near)
        found[grid.rows[i]] = grid.rows[near[:count]].tolist()
    return found


def brute_force(points, radius, in_plan):
    steps = points[:, None] - points[None]
    if in_plan:
        steps = steps[..., :2]
    near = (steps**2).sum(axis=-1) <= radius**2
    return [set(np.flatnonzero(row)) for row in near]


@pytest.mark.parametrize("in_plan", [False, True])
@pytest.mark.parametrize("radius", [0.3, 1.0, 20.0])
def test_the_neighbours_are_those_that_brute_force_finds(radius, in_plan):
    points = cloud()
    found = neighbours(points, radius, in_plan)
    assert [set(f) for f in found] == brute_force(points, radius, in_plan)
    assert all(len(set(f)) == len(f) for f in found)


def test_a_neighbour_exactly_at_the_radius_counts():
    found = neighbours([[0, 0, 0], [1, 0, 0], [1, 0, 1.0]], 1.0)
    assert [len(near) for near in found] == [2, 3, 2]


def test_the_sequence_of_points_does_not_depend_on_the_order_of_rows():
    points = np.round(cloud(), 1)
    shuffled = np.random.default_rng(1).permutation(points)
    assert np.array_equal(build_grid(points, 0.7).points, build_grid(shuffled, 0.7).points)


def test_columns_lie_at_multiples_of_their_size_from_the_origin():
    grid = build_grid(cloud(offset=100.3), 0.7)
    for c in range(len(grid.first) - 1):
        inside = grid.points[grid.first[c] : grid.first[c + 1], :2]
        assert len(np.unique(np.floor(inside / 0.7), axis=0)) == 1


def test_points_within_a_column_rise():
    grid = build_grid(cloud(), 2.0)
    for c in range(len(grid.first) - 1):
        assert np.all(np.diff(grid.points[grid.first[c] : grid.first[c + 1], 2]) >= 0)


def test_rows_lead_back_to_the_input():
    points = cloud()
    grid = build_grid(points, 0.7)
    assert np.array_equal(points[grid.rows], grid.points)


@pytest.mark.parametrize(
    "points",
    [np.zeros((0, 3)), np.zeros((1, 3)), np.ones((30, 3)), np.array([[-1e12, 0, 0], [1e12, 1e12, 5.0]])],
    ids=["empty", "single", "identical", "far apart"],
)
def test_degenerate_clouds_are_legal(points):
    found = neighbours(points, 1e-3)
    distinct = len(np.unique(points, axis=0))
    assert all(len(near) == (len(points) if distinct == 1 else 1) for near in found)


@pytest.mark.parametrize("size", [0.0, -1.0, np.nan])
def test_a_size_that_is_no_length_is_refused_by_name(size):
    with pytest.raises(ValueError, match="size"):
        build_grid(cloud(), size)
