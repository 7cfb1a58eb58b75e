"""Roofs by the planes that most neighbours vote for."""

import numpy as np

from lidar_buildings.core.neighbours.columns import by_column
from lidar_buildings.core.stages.roof_selection.candidates import Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.smooth_patches.plane_votes import (
    N_VOTERS,
    find_voted_roofs,
    plane_votes,
)

SPACING = 1.7


def gable_of_a_few_points(slope=0.7, seed=0):
    """Return points of a gable roof 8 m wide, with 3 cm of noise; its ridge at x = 0."""
    chance = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(-4.0, 4.01, SPACING), np.arange(0.0, 12.01, SPACING))
    x, y = (part.ravel() + chance.uniform(-0.3, 0.3, part.size) for part in (x, y))
    return np.column_stack([x, y, 8.0 - slope * abs(x) + chance.normal(0.0, 0.03, x.size)])


def crown():
    """Return points of a crown of 8 m."""
    return np.random.default_rng(1).uniform(0.0, 8.0, (40, 3))


def roof_share(points, is_last=None, is_only=None, ground=None):
    """Return the share of points that are roof."""
    columns = by_column(points, SPACING)
    every, ground = np.ones(len(points), dtype=bool), np.zeros((0, 3)) if ground is None else ground
    is_last, is_only = ((every if one is None else one)[columns.rows] for one in (is_last, is_only))
    candidates = Candidates(columns, is_last, is_only, lambda: ground, 2.25 * SPACING, 2.0 * SPACING)
    return find_voted_roofs(candidates, RoofSelectionConfig()).mean()


def test_neighbours_on_both_faces_of_a_gable_of_forty_points_vote():
    points = gable_of_a_few_points()
    assert len(points) == 40
    # Where faces are two points wide, half of twelve neighbours or so lie on the other one.
    assert (plane_votes(points, 0.125) >= 6).mean() > 0.7


def test_a_crown_has_few_votes():
    assert (plane_votes(crown(), 0.125) >= 7).mean() < 0.1


def test_no_more_points_than_voters_have_no_plane():
    assert not plane_votes(np.zeros((N_VOTERS, 3)), 0.125).any()


def test_a_gable_of_forty_points_is_roof_up_to_the_ridge_whether_returns_are_known_or_not():
    points = gable_of_a_few_points()
    assert roof_share(points) > 0.9
    some = np.arange(len(points)) % 8 > 0
    assert roof_share(points, some, some) > 0.9


def test_a_crown_is_no_roof_whether_returns_are_known_or_not():
    assert roof_share(crown()) == 0.0
    every_other = np.arange(len(crown())) % 2 == 0
    assert roof_share(crown(), every_other, every_other) == 0.0


def test_a_deck_of_few_points_is_no_roof():
    x, y = (one.ravel() for one in np.meshgrid(np.arange(0.0, 60.0, SPACING), np.arange(0.0, 8.0, SPACING)))
    deck = np.column_stack([x, y, np.full(x.size, 6.0)])
    ground = np.vstack([deck + np.array([shift, 0.0, 0.0]) for shift in (-60.0, 60.0)])
    assert roof_share(deck) == 1.0
    assert roof_share(deck, ground=ground) == 0.0


def test_few_points_are_no_roof():
    assert roof_share(np.zeros((3, 3))) == 0.0
