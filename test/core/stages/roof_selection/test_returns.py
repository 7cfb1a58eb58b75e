"""
Returns end their pulse, or are all of it; some scanners record two of every pulse, be there one echo or two.
"""

import numpy as np
import pytest

from bench.scenes import buildings as scenes
from lidar_buildings.core.stages.roof_selection.selection import last_and_only_returns, select_roofs


def test_without_numbers_every_return_is_the_only_one():
    for numbers in ((None, None), (np.array([1, 2]), None), (None, np.array([2, 2]))):
        assert np.array(last_and_only_returns(2, *numbers)).all()


def test_numbers_say_which_returns_are_last_and_only():
    last, only = last_and_only_returns(4, np.array([1, 1, 2, 3]), np.array([1, 3, 3, 3]))
    assert last.tolist() == [True, False, False, True]
    assert only.tolist() == [True, False, False, False]


def test_where_no_pulse_has_a_single_return_every_one_counts_as_such():
    last, only = last_and_only_returns(4, np.array([1, 2, 1, 2]), np.full(4, 2))
    assert last.tolist() == [False, True, False, True]
    assert only.all()


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
