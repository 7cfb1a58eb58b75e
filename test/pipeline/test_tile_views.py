"""Tiles of points from above and from the street."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from lidar_buildings.core.model.classes import FacadeClass, PointClass, View
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.strip_views import with_covered
from lidar_buildings.pipeline.reconstruct import reconstruct_tile
from lidar_buildings.simulation import simulate_tile
from lidar_buildings.simulation.building import Building

SPACING = 0.35


def walls_and_street(building: Building, seed: int = 0) -> NDArray[np.float64]:
    """Return dense points on a building's walls, and on the ground in front of them [m]."""
    draw, low = np.random.default_rng(seed), building.ground_elevation
    on_wall, before = (
        shapely.get_coordinates(
            shapely.line_interpolate_point(
                building.polygon.buffer(away).exterior, draw.uniform(0.0, 1.0, 12_000), normalized=True
            )
        )
        for away in (0.0, 3.0)
    )
    rise = draw.uniform(0.0, building.roof_elevation_range[0] - low, len(on_wall))
    walls = np.column_stack([on_wall, low + rise])
    return np.concatenate([walls, np.column_stack([before, np.full(len(before), low)])])


@pytest.fixture(scope="module")
def above() -> tuple[PointTile, list[Building]]:
    """A house seen from above."""
    tile, truth = simulate_tile("single_house", density=8.0)
    return tile.with_columns(point_spacing=SPACING), list(truth.scene.buildings)


def test_points_from_the_street_change_no_outline_and_are_classified(
    above: tuple[PointTile, list[Building]],
) -> None:
    tile, buildings = above
    street = np.concatenate([walls_and_street(one) for one in buildings])
    view = np.repeat([View.ABOVE, View.STREET], [len(tile), len(street)]).astype(np.uint8)
    points = np.concatenate([tile.points, street])
    n = len(street)
    both = PointTile(
        points,
        view=with_covered(points, view, SPACING),
        point_spacing=SPACING,
        **{name: np.concatenate([column, np.zeros(n)]) for name, column in tile.columns.items()},
    )

    alone, together = (reconstruct_tile(one, until="regularisation") for one in (tile, both))

    assert len(alone.outlines) == len(buildings)
    for one, other in zip(alone.outlines, together.outlines, strict=True):
        np.testing.assert_array_equal(one.outline.exterior, other.outline.exterior)
    found = together.classified.select(together.classified.is_covered)
    assert len(found) == n
    assert not found.is_roof.any()
    height = found.height_above_ground
    is_facade = (found.classification == PointClass.BUILDING) & (found.facade == FacadeClass.BELOW_ROOF)
    assert is_facade[height > 1.0].mean() > 0.8  # the roof's own points end up to a spacing before its edge
    assert (found.classification[height < 0.1] == PointClass.GROUND).mean() > 0.95
