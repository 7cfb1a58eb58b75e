"""Roofs by the planes that most neighbours vote for."""

import numpy as np

from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.roof_selection.candidates import Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.roof_patches import find_voted_surface

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


def is_roof(points, is_last=None, is_only=None, ground=None, member="is_surface"):
    """Return which points start roofs, row by row, or are of another member of the surface."""
    columns = sort_by_cell(points, SPACING)
    every, ground = np.ones(len(points), dtype=bool), np.zeros((0, 3)) if ground is None else ground
    is_last, is_only = ((every if one is None else one)[columns.rows] for one in (is_last, is_only))
    candidates = Candidates(columns, is_last, is_only, lambda: ground, 2.25 * SPACING, 2.0 * SPACING)
    surface = find_voted_surface(candidates, RoofSelectionConfig())
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0)
    found = np.zeros(len(points), dtype=bool)
    found[columns.rows] = getattr(surface, member)
    return found


def roof_share(points, **known):
    """Return the share of points that start roofs."""
    return is_roof(points, **known).mean()


def test_a_gable_of_forty_points_is_roof_up_to_the_ridge_whether_returns_are_known_or_not():
    points = gable_of_a_few_points()
    assert roof_share(points) > 0.9
    some = np.arange(len(points)) % 8 > 0
    # What is no last return has no plane of its own: roofs grow to it.
    assert is_roof(points, is_last=some, is_only=some)[some].mean() > 0.9


def test_a_crown_is_no_roof_whether_returns_are_known_or_not():
    assert roof_share(crown()) == 0.0
    every_other = np.arange(len(crown())) % 2 == 0
    assert roof_share(crown(), is_last=every_other, is_only=every_other) == 0.0


def test_shrubs_on_open_ground_are_no_roof_whatever_house_is_the_nearest():
    house = gable_of_a_few_points()
    shrubs = house[:3] + np.array([25.0, 0.0, -5.0])
    x, y = (
        one.ravel() for one in np.meshgrid(np.arange(-9.0, 30.0, SPACING), np.arange(-5.0, 18.0, SPACING))
    )
    beside = (abs(x) > 4.5) | (abs(y - 6.0) > 6.5)
    ground = np.column_stack([x, y, np.zeros(x.size)])[beside]
    found = is_roof(np.vstack([house, shrubs]), ground=ground)
    assert found[: len(house)].mean() > 0.8
    assert not found[len(house) :].any()


def test_no_roof_grows_into_a_crown_beside_it_whatever_is_at_its_height():
    house = gable_of_a_few_points()
    tree = crown() + np.array([5.0, 2.0, 0.0])
    split = np.arange(len(house) + len(tree)) < len(house)
    barred = is_roof(np.vstack([house, tree]), is_last=split, is_only=split, member="is_other")
    assert not barred[: len(house)].any()
    assert barred[len(house) :].mean() > 0.8
    # A pulse that a ridge splits has no votes of its own either.
    ridge = np.arange(len(house)) != np.argmax(house[:, 2])
    assert not is_roof(house, is_last=ridge, is_only=ridge, member="is_other").any()


def test_a_deck_of_few_points_is_no_roof():
    x, y = (one.ravel() for one in np.meshgrid(np.arange(0.0, 60.0, SPACING), np.arange(0.0, 8.0, SPACING)))
    deck = np.column_stack([x, y, np.full(x.size, 6.0)])
    ground = np.vstack([deck + np.array([shift, 0.0, 0.0]) for shift in (-60.0, 60.0)])
    assert roof_share(deck) == 1.0
    assert roof_share(deck, ground=ground) == 0.0
