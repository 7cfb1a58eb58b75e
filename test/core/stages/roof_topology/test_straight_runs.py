"""Sides of cells in chains along steps, and straight runs through them."""

import numpy as np
import pytest

from lidar_buildings.core.stages.roof_topology.step_edges import step_chains, straight_runs


def staircase(n, rise):
    """Middles of the sides of unit cells along a rising line, and which are upright."""
    rows = np.floor(rise * np.arange(n + 1)).astype(int)
    xy, upright = [], []
    for k in range(n):
        xy.append((k + 0.5, rows[k]))
        upright.append(False)
        for row in range(rows[k], rows[k + 1]):
            xy.append((k + 1.0, row + 0.5))
            upright.append(True)
    return np.array(xy, dtype=float), np.array(upright)


def test_an_oblique_step_is_one_run_in_a_direction_of_its_own():
    xy, upright = staircase(60, 0.3)
    shuffled = np.random.default_rng(0).permutation(len(xy))
    xy, upright = xy[shuffled], upright[shuffled]
    chains = step_chains(xy, upright, np.ones(len(xy), dtype=np.int32), np.zeros(len(xy)), 1.0)
    assert chains[1].tolist() == [0, len(xy)]
    runs, run = straight_runs(xy, chains, np.array([0.0, np.pi / 2]), 1.0, 2.0)
    assert len(runs) == 1
    assert not run.any()
    assert np.tan(runs[0, 0]) == pytest.approx(0.3, abs=0.02)


def test_where_three_roofs_meet_the_wall_of_the_highest_goes_on():
    xy = np.array([[0.5, 0.0], [1.5, 0.0], [1.0, -0.5]])
    upper, top = np.array([1, 1, 2], dtype=np.int32), np.array([9.0, 9.0, 5.0])
    order, begin, is_closed = step_chains(xy, np.array([False, False, True]), upper, top, 1.0)
    assert sorted(order[begin[0] : begin[1]]) == [0, 1]
    assert order[begin[1] :].tolist() == [2]
    assert not is_closed.any()


def test_a_step_round_a_box_is_closed_and_has_four_runs():
    along = np.arange(20) + 0.5
    level = [np.column_stack([along, np.full(20, y)]) for y in (0.0, 20.0)]
    xy = np.concatenate([*level, *(one[:, ::-1] for one in level)])
    upright = np.arange(80) >= 40
    chains = step_chains(xy, upright, np.ones(80, dtype=np.int32), np.zeros(80), 1.0)
    assert chains[2].tolist() == [True]
    assert len(straight_runs(xy, chains, np.array([0.0, np.pi / 2]), 1.0, 2.0)[0]) == 4
