"""From where points were seen, told by the place of their scanner."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidar_buildings.core.model.classes import View
from lidar_buildings.core.scans.trajectory import Poses
from lidar_buildings.core.scans.viewpoint import view_from


@pytest.mark.parametrize(
    ("height", "expected"), [(1.8, View.STREET), (40.0, View.ABOVE), (900.0, View.ABOVE)]
)
def test_the_height_of_a_scanner_above_the_ground_tells_its_view(height: float, expected: View) -> None:
    draw = np.random.default_rng(0)
    ground = np.column_stack([draw.uniform(-30.0, 30.0, (3_000, 2)), np.full(3_000, 100.0)])
    facade = np.column_stack(
        [np.full(1_000, 12.0), draw.uniform(-9.0, 9.0, 1_000), draw.uniform(100, 120, 1_000)]
    )
    points = np.concatenate([ground, facade])
    times = draw.integers(0, 2_000_000_000, len(points))

    def look_up(times: NDArray[np.int64]) -> Poses:
        places = np.tile([0.0, 0.0, 100.0 + height], (len(times), 1))
        return Poses(places, Rotation.identity(len(times)), np.ones(len(times), bool))

    assert (view_from(look_up, times, points) == expected).all()
