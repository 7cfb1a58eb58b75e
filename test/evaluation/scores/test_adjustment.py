"""Table 1 of Sampath & Shan, worked out by hand."""

import math

import numpy as np
import pytest

from lidar_buildings.evaluation.scores.outlines import score_adjustment


def test_sigma_comes_from_the_mean_variance_and_the_rest_are_means():
    score = score_adjustment([0.5, 1.5], [0.1, 0.7], [0.4, 1.2])
    assert (score.n_buildings, score.n_as_traced) == (2, 0)
    assert (score.spacing, score.max_offset) == (1.0, pytest.approx(0.8))
    # √((0.01 + 0.49) / 2)
    assert score.sigma == score.sigma_share == pytest.approx(0.5)
    assert score.max_offset_share == pytest.approx(0.8)


def test_buildings_that_kept_their_traced_outline_or_say_nothing_are_left_out():
    score = score_adjustment([1.0, 1.0, 1.0, np.nan], [0.2, 0.0, np.nan, 0.3], [1.0, 0.0, 9.0, 9.0])
    assert (score.n_buildings, score.n_as_traced) == (1, 1)
    assert (score.sigma, score.max_offset) == (pytest.approx(0.2), 1.0)


def test_no_building_has_no_mean():
    score = score_adjustment([], [], [])
    assert score.n_buildings == 0
    assert all(map(math.isnan, (score.spacing, score.sigma, score.max_offset_share, score.sigma_share)))


def test_columns_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match="one per building"):
        score_adjustment([1.0], [1.0, 2.0], [1.0])
