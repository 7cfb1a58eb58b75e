"""
Returns end their pulse, or are all of it; some scanners record two of every pulse, be there one echo or two.
"""

import numpy as np
import pytest

from bench.scenes import buildings as scenes
from lidar_buildings.core.stages.roof_selection.selection import last_and_only_returns, select_roofs


def test_without_numbers_every_return_is_the_only_one():
    for numbers in ((None, None), (np.array([1, 2]), None), (None, np.array([2, 2]))):
        assert np.array(last_and_only_returns(np.zeros((2, 3)), *numbers)).all()


def test_numbers_say_which_returns_are_last_and_only():
    points = np.zeros((4, 3))
    last, only = last_and_only_returns(points, np.array([1, 1, 2, 3]), np.array([1, 3, 3, 3]))
    assert last.tolist() == [True, False, False, True]
    assert only.tolist() == [True, False, False, False]


def test_an_echo_recorded_as_first_and_as_last_is_the_only_one():
    points = np.array([[0.0, 0.0, 5.0], [0.02, 0.01, 4.95], [3.0, 0.0, 9.0], [3.0, 0.0, 1.0]])
    last, only = last_and_only_returns(points, np.array([1, 2, 1, 2]), np.full(4, 2))
    assert last.tolist() == [True, True, False, True]
    assert only.tolist() == [True, True, False, False]


def test_where_single_returns_are_known_nothing_else_is_taken_for_one():
    points = np.array([[0.0, 0.0, 5.0], [0.02, 0.01, 4.95], [9.0, 9.0, 9.0]])
    only = last_and_only_returns(points, np.array([1, 2, 1]), np.array([2, 2, 1]))[1]
    assert only.tolist() == [False, False, True]


@pytest.mark.parametrize("density", [1.0, 8.0])
def test_roofs_are_found_where_every_pulse_is_recorded_twice(density):
    scene = scenes.gable(density=density)
    shift = np.random.default_rng(0).normal(0.0, 0.02, scene.points.shape)
    points = np.vstack([scene.points, scene.points + shift])
    number = np.repeat([1, 2], len(scene.points))
    height = np.where(scene.is_ground, 0.0, scene.points[:, 2] - scenes.GROUND)
    found = select_roofs(
        points,
        height_above_ground=np.tile(height, 2),
        classification=np.tile(np.where(scene.is_ground, 2, 1), 2),
        return_number=number,
        number_of_returns=np.full(len(points), 2),
    )
    is_roof = (found.classification == 6) & ~found.is_facade
    assert is_roof[np.tile(scene.is_roof, 2)].mean() > 0.95
