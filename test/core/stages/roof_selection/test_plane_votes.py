"""Planes that most neighbours vote for."""

import numpy as np

from lidar_buildings.core.stages.roof_selection.smooth_patches.plane_votes import (
    N_VOTERS,
    mean_votes,
    plane_votes,
)
from lidar_buildings.core.stages.roof_selection.smooth_patches.roofs import MIN_VOTES, SURE_VOTES


def gable_of_a_few_points(spacing=1.7, slope=0.7, seed=0):
    """Return points of a gable roof 8 m wide, with 3 cm of noise; its ridge at x = 0."""
    chance = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(-4.0, 4.01, spacing), np.arange(0.0, 12.01, spacing))
    x, y = (part.ravel() + chance.uniform(-0.3, 0.3, part.size) for part in (x, y))
    return np.column_stack([x, y, 8.0 - slope * abs(x) + chance.normal(0.0, 0.03, x.size)])


def test_both_faces_of_a_gable_of_forty_points_are_found_up_to_the_ridge():
    points = gable_of_a_few_points()
    votes, normals = plane_votes(points, 0.125)
    assert len(points) == 40
    # Where faces are two points wide, half of twelve neighbours or so lie on the other one.
    assert (votes >= 6).mean() > 0.7
    off_ridge = (abs(points[:, 0]) > 0.5) & (votes >= 6)
    normal = np.array([0.7, 0.0, 1.0]) / np.hypot(0.7, 1.0)
    turned = normals.copy()
    turned[:, 0] *= np.sign(points[:, 0])
    assert ((turned @ normal)[off_ridge] > np.cos(np.radians(10))).mean() > 0.9


def test_a_crown_has_few_votes():
    crown = np.random.default_rng(1).uniform(0.0, 8.0, (40, 3))
    assert (plane_votes(crown, 0.125)[0] >= 7).mean() < 0.1


def test_fewer_points_than_voters_have_no_plane():
    votes, normals = plane_votes(np.zeros((N_VOTERS, 3)), 0.125)
    assert not votes.any()
    np.testing.assert_array_equal(normals, np.tile([0.0, 0.0, 1.0], (N_VOTERS, 1)))


def test_a_point_of_a_gable_without_votes_of_its_own_is_carried_by_those_around():
    points = gable_of_a_few_points()
    votes, _ = plane_votes(points, 0.125)
    middle = int(np.argmin(abs(points[:, 0]) + abs(points[:, 1] - 6.0)))
    votes[middle] = 0
    mean = mean_votes(points, votes)
    assert mean[middle] >= MIN_VOTES
    assert (mean >= MIN_VOTES).mean() > 0.9


def test_a_crown_is_never_surely_roof_and_no_roof_where_it_splits_pulses():
    crown = np.random.default_rng(1).uniform(0.0, 8.0, (40, 3))
    # Planes by chance: four votes in the mean where every return is the only one of its pulse.
    votes, _ = plane_votes(crown, 0.125)
    assert mean_votes(crown, votes).max() < SURE_VOTES
    is_last = np.arange(len(crown)) % 2 == 0
    votes[is_last], votes[~is_last] = plane_votes(crown[is_last], 0.125)[0], 0
    assert mean_votes(crown, votes).max() < MIN_VOTES


def test_mean_votes_of_few_points_are_their_own():
    np.testing.assert_array_equal(mean_votes(np.zeros((3, 3)), np.array([0, 2, 1])), [0.0, 2.0, 1.0])
