"""Corners of roofs that no point explains are found and told."""

import numpy as np
import pytest

from lidar_buildings.core.model.grade import Cause
from lidar_buildings.core.solids.plan_graph import RoofPiece
from lidar_buildings.core.solids.raising import roof_solid
from lidar_buildings.core.stages.building_model.spikes import MARGIN, spike_doubts, spikes_of

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
SPACING = 0.4
POINTS = np.column_stack([np.random.default_rng(0).uniform(0.0, 10.0, (600, 2)), np.full(600, 6.0)])


def tilted(rise):
    """A roof through the middle of level points, whose sides rise and sink."""
    return roof_solid([RoofPiece((SQUARE,), (rise, 0.0, 6.0 - 5.0 * rise))], 0.0)


@pytest.mark.parametrize("rise", [0.0, 0.05])
def test_corners_near_the_points_are_no_spikes(rise):
    assert not list(spikes_of(tilted(rise), POINTS, SPACING))


@pytest.mark.parametrize("rise", [0.5, -0.5])
def test_corners_far_above_and_below_all_points_near_are_spikes(rise):
    found = list(spikes_of(tilted(rise), POINTS, SPACING))
    assert len(found) == 4
    for spike in found:
        beyond = abs(spike.xyz[2] - 6.0) - MARGIN - 0.5 * SPACING
        assert abs(spike.excess) == pytest.approx(beyond, abs=0.01)
        assert (spike.excess > 0.0) == (spike.xyz[2] > 6.0)
    (doubt,) = spike_doubts(tilted(rise), POINTS, SPACING)
    assert doubt.cause is Cause.SPIKE
    assert "2.3 m" in doubt.text


def test_small_ones_are_no_doubt():
    assert list(spikes_of(tilted(0.2), POINTS, SPACING))
    assert not list(spike_doubts(tilted(0.2), POINTS, SPACING))
