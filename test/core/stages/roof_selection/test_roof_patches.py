"""Which smooth patches start roofs."""

import numpy as np
import pytest

from lidar_buildings.core.neighbours.cell_grid import sort_by_cell
from lidar_buildings.core.stages.roof_selection.candidates import Candidates
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.roof_patches import find_roof_surface


def started(width, split_share, noise=0.0, length=5.0):
    """Return which share of a level patch starts a roof, of whose pulses a share is split."""
    random = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(0.0, width, 0.25), np.arange(0.0, length, 0.25))
    points = np.column_stack([x.ravel(), y.ravel(), random.normal(5.0, noise, x.size)])
    columns = sort_by_cell(points, 0.375)
    is_only = random.permutation(np.arange(len(points)) >= split_share * len(points))
    is_last, ground = np.ones(len(points), dtype=bool), np.zeros((0, 3))
    candidates = Candidates(columns, is_last, is_only, lambda: ground, 0.75, 0.5)
    return find_roof_surface(candidates, RoofSelectionConfig()).is_surface.mean()


@pytest.mark.parametrize(("split_share", "width", "starts"), [(0.4, 5.0, 1), (0.6, 5.0, 0), (0.6, 10.0, 1)])
def test_small_patches_of_split_pulses_are_foliage(split_share, width, starts):
    assert started(width, split_share) == starts


@pytest.mark.parametrize(
    ("noise", "width", "starts"), [(0.05, 5.0, True), (0.1, 5.0, False), (0.1, 10.0, True)]
)
def test_the_smaller_a_patch_the_smoother_it_has_to_be(noise, width, starts):
    share = started(width, 0.0, noise)
    assert share > 0.8 if starts else share < 0.2


def test_patches_below_two_square_metres_start_nothing():
    assert started(1.0, 0.0, length=1.5) == 0.0
    assert started(1.0, 0.0, length=2.5) == 1.0
