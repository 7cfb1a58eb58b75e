"""Planes that most neighbours vote for."""

import numpy as np

from lidar_buildings.core.stages.roof_selection.smooth_patches.plane_votes import N_VOTERS, plane_votes


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
