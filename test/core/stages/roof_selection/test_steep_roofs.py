"""Roofs steeper than others are, beside walls and conical trees."""

import numpy as np
import pytest

from bench.scenes.spires import spire
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.stages.roof_selection.selection import select_roofs


@pytest.mark.parametrize("density", [10.0, 25.0])
@pytest.mark.parametrize(("slope_deg", "least"), [(78.0, 0.8), (85.0, 0.4)])
@pytest.mark.parametrize("plan", ["square", "cone"])
def test_a_spire_is_roof_and_the_walls_below_it_are_not(plan, slope_deg, least, density):
    made = spire(plan, "gable end", slope_deg, density=density, seed=1)
    points = made.scene.points
    found = select_roofs(points, **made.scene.columns)
    is_roof = (found.classification == PointClass.BUILDING) & ~found.is_facade
    is_spire = made.scene.is_building & (made.shape.depth(*points[:, :2].T) > 0.0)
    assert is_roof[is_spire & (points[:, 2] > made.bottom)].mean() > least
    assert is_roof[made.scene.is_facade].mean() < 0.25


@pytest.mark.parametrize(("density", "depth"), [(8.0, 0.4), (20.0, 0.8)])
def test_a_conical_tree_is_no_spire(density, depth):
    random = np.random.default_rng(0)
    xy = random.uniform(0.0, 40.0, (int(density * 1600), 2))
    z, returns = np.zeros(len(xy)), np.ones(len(xy), dtype=np.uint8)
    for middle in random.uniform(5.0, 35.0, (12, 2)):
        away = np.hypot(*(xy - middle).T)
        crown = away < 2.5
        # Pulses enter the crown by so much in plan before they meet a branch.
        inside = away + random.exponential(depth, len(xy))
        z[crown] = np.maximum(z, 18.0 * (1.0 - inside / 2.5).clip(0.0))[crown]
    points = np.column_stack((xy, z + random.normal(0.0, 0.03, len(xy))))
    classes = np.where(z > 0.0, 1, 2).astype(np.uint8)
    found = select_roofs(
        points,
        height_above_ground=points[:, 2],
        classification=classes,
        return_number=returns,
        number_of_returns=returns,
    )
    assert not (found.classification == PointClass.BUILDING).any()
