import numpy as np
import pytest

from lidar_buildings.core.neighbours.sectors import N_SECTORS, sector_of


@pytest.mark.parametrize("turn_deg", [0.0, 1.0, 44.9, 45.0, 60.0, 90.0, 135.0, 179.9])
def test_sectors_are_eighths_of_a_turn_and_opposites_differ_by_four(turn_deg):
    exact = {0.0: (1.0, 0.0), 45.0: (1.0, 1.0), 90.0: (0.0, 1.0), 135.0: (-1.0, 1.0)}
    angle = np.deg2rad(turn_deg)
    dx, dy = exact.get(turn_deg, (np.cos(angle), np.sin(angle)))
    assert sector_of(dx, dy) == turn_deg // 45
    assert sector_of(-dx, -dy) == turn_deg // 45 + N_SECTORS // 2
