import math

import numpy as np
import pytest

from lidar_buildings.core.stages.ground_filter import landforms
from lidar_buildings.core.stages.ground_filter.landforms import (
    MIN_SPREAD,
    ROWS_A_BLOCK,
    SIDES,
    continues_terrain,
)


def lattice(width, depth, seed=0):
    """Jittered points 1 m apart over a level rectangle, 2 cm rough."""
    random = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(0.0, width), np.arange(0.0, depth))
    xy = np.column_stack((x.ravel(), y.ravel())) + random.uniform(0, 0.8, (x.size, 2))
    return np.column_stack((xy, random.normal(0, 0.02, x.size)))


def continues_by_least_squares(candidates, rows, ground, spacing):
    """What `continues_terrain` returns, with a plane by least squares through each half plane's points."""
    found = np.zeros(len(rows), dtype=bool)
    for r, row in enumerate(rows):
        around = candidates[ground] - candidates[row]
        around = around[np.hypot(*around[:, :2].T) <= landforms.PLANE_REACH * spacing]
        for side in range(SIDES):
            turn = 2 * math.pi * side / SIDES
            those = around[around[:, 0] * math.cos(turn) + around[:, 1] * math.sin(turn) > 1e-9]
            if len(those) < landforms.MIN_PLANE_POINTS:
                continue
            spread = np.linalg.eigvalsh(np.cov(those[:, :2].T))
            if 4 * spread[0] * spread[1] <= MIN_SPREAD * spread.sum() ** 2:
                continue
            design = np.column_stack((those[:, :2], np.ones(len(those))))
            plane = np.linalg.lstsq(design, those[:, 2], rcond=None)[0]
            residual = np.sqrt(np.mean((design @ plane - those[:, 2]) ** 2))
            found[r] |= (
                np.hypot(*those[:, :2].T).min() <= landforms.PLANE_NEAREST * spacing
                and np.hypot(*plane[:2]) <= landforms.MAX_SLOPE
                and residual <= landforms.MAX_RESIDUAL
                and abs(plane[2]) <= landforms.MAX_DISTANCE + residual
            )
    return found


@pytest.mark.parametrize("roughness", [0.25, 0.4, 0.6])
@pytest.mark.parametrize("share", [0.2, 0.6])
def test_points_continue_the_planes_that_least_squares_fit_to_half_planes(roughness, share):
    random = np.random.default_rng(int(100 * roughness))
    candidates = lattice(30.0, 30.0)
    candidates[:, 2] = 0.5 * candidates[:, 0] + random.normal(0, roughness, len(candidates))
    ground = random.random(len(candidates)) < share
    rows = np.flatnonzero(~ground)
    found = continues_terrain(candidates, rows, ground, 1.0)
    expected = continues_by_least_squares(candidates, rows, ground, 1.0)
    np.testing.assert_array_equal(found, expected)
    assert 0 < expected.sum() < len(rows)


def cliff():
    """
    Ground at 0 m up to x = 20, a plateau at 6 m beyond; the plateau's outer metre is not yet known as ground.
    """
    candidates = lattice(40.0, 20.0)
    plateau = candidates[:, 0] > 20.0
    candidates[plateau, 2] += 6.0
    return candidates, ~plateau | (candidates[:, 0] > 21.0)


def test_the_rim_of_a_cliff_continues_the_plateau_behind_it():
    candidates, ground = cliff()
    assert continues_terrain(candidates, np.flatnonzero(~ground), ground, 1.0).all()


def test_a_roof_amid_ground_continues_nothing():
    candidates = lattice(30.0, 30.0)
    roof = (abs(candidates[:, :2] - 15.0) < 4.0).all(axis=1)
    candidates[roof, 2] += 3.0
    assert not continues_terrain(candidates, np.flatnonzero(roof), ~roof, 1.0).any()


def test_a_point_above_the_plane_by_more_than_its_tolerance_does_not_continue_it():
    candidates = np.vstack((lattice(20.0, 20.0), [[10.0, 10.0, 0.25], [10.1, 14.1, 0.4], [14.1, 10.1, -0.4]]))
    rows = np.arange(len(candidates) - 3, len(candidates))
    ground = np.arange(len(candidates)) < rows[0]
    np.testing.assert_array_equal(continues_terrain(candidates, rows, ground, 1.0), [True, False, False])


@pytest.mark.parametrize(("slope", "continued"), [(0.6, True), (1.0, False)])
def test_planes_too_steep_are_no_ground_to_continue(slope, continued):
    candidates = lattice(20.0, 20.0)
    candidates[:, 2] += slope * candidates[:, 1]
    ground = np.hypot(*(candidates[:, :2] - 10.0).T) > 1.5
    assert (continues_terrain(candidates, np.flatnonzero(~ground), ground, 1.0) == continued).all()


def test_ground_too_far_away_is_not_continued():
    candidates = lattice(30.0, 20.0)
    ground = candidates[:, 0] > 15.0
    found = continues_terrain(candidates, np.flatnonzero(~ground), ground, 1.0)
    x = candidates[~ground, 0]
    assert found[x > 14.0].all()
    assert not found[x < 12.5].any()


def test_rows_far_from_all_ground_continue_nothing():
    candidates = np.vstack((lattice(10.0, 10.0), [[-500.0, 5.0, 0.0], [500.0, 5.0, 0.0], [5.0, 1e9, 0.0]]))
    ground = np.arange(len(candidates)) < 100
    assert not continues_terrain(candidates, np.array([100, 101, 102]), ground, 1.0).any()


def test_an_enormous_extent_changes_nothing():
    candidates, ground = cliff()
    # Numbers of cells beyond 2^53, which a float would round.
    moved = candidates + np.array([1e9 + 7.0, 1e9 + 7.0, 0.0])
    strayed = np.vstack((moved, [[0.0, 0.0, 0.0]]))
    found = continues_terrain(strayed, np.flatnonzero(~ground), np.append(ground, True), 1.0)
    assert found.all()


def test_more_rows_than_a_block_of_work_and_any_order_are_answered_alike():
    candidates = lattice(60.0, 40.0, seed=3)
    candidates[:, 2] += np.random.default_rng(0).normal(0, 0.3, len(candidates))
    ground = np.arange(len(candidates)) % 3 == 0
    rows = np.flatnonzero(~ground)
    assert len(rows) > ROWS_A_BLOCK
    found = continues_terrain(candidates, rows, ground, 1.0)
    order = np.random.default_rng(1).permutation(len(candidates))
    shuffled = continues_terrain(candidates[order], np.argsort(order)[rows], ground[order], 1.0)
    np.testing.assert_array_equal(shuffled, found)
    some = slice(ROWS_A_BLOCK - 30, ROWS_A_BLOCK + 30)
    np.testing.assert_array_equal(found[some], continues_terrain(candidates, rows[some], ground, 1.0))


@pytest.mark.parametrize("n", [0, 1, 2])
def test_none_one_and_two_continue_nothing(n):
    candidates = np.zeros((n, 3)) + np.arange(n)[:, None]
    for ground in (np.zeros(n, dtype=bool), np.ones(n, dtype=bool)):
        assert not continues_terrain(candidates, np.arange(n), ground, 1.0).any()


def test_no_rows_have_no_answers():
    candidates = lattice(10.0, 10.0)
    found = continues_terrain(candidates, np.zeros(0, dtype=np.intp), np.ones(100, dtype=bool), 1.0)
    assert found.shape == (0,)


@pytest.mark.parametrize(
    "step", [(0.1, 0.0), (0.06, 0.08), (0.0, 0.0)], ids=["along x", "slanting", "one place"]
)
def test_points_on_a_line_or_at_one_place_make_no_plane(step):
    candidates = np.column_stack((np.outer(np.arange(40.0), step), np.zeros(40)))
    ground = np.arange(40) % 2 == 0
    assert not continues_terrain(candidates, np.flatnonzero(~ground), ground, 1.0).any()
