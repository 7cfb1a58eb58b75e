"""Ground between known places: five methods, on planes, hills, and vertices that span nothing."""

import numpy as np
import pytest

from lidar_buildings.core.model.point_array import extent_of
from lidar_buildings.core.stages.terrain.interpolation import METHODS, interpolator

RANDOM = np.random.default_rng(0)
PLAN = RANDOM.uniform(0.0, 40.0, (600, 2))
PLACES = RANDOM.uniform(4.0, 36.0, (200, 2))


def elevations(vertices, method):
    return interpolator(vertices, extent_of(PLACES), method)(PLACES)


def hill(xy):
    return 3.0 * np.sin(xy[:, 0] / 9.0) + 0.2 * xy[:, 1]


@pytest.mark.parametrize("method", METHODS)
def test_a_hill_is_found_between_its_points_in_any_order(method):
    if method == "natural_neighbour":
        pytest.importorskip("startinpy")
    vertices = np.column_stack([PLAN, hill(PLAN)])
    found = elevations(vertices, method)
    largest = {"linear": 0.15, "natural_neighbour": 0.12, "idw": 0.6, "spline": 0.08, "kriging": 0.08}[method]
    assert np.abs(found - hill(PLACES)).max() < largest
    again = elevations(vertices[::-1], method)
    np.testing.assert_allclose(again, found, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("n", [1, 2, 4])
def test_vertices_that_span_nothing_still_give_elevations(method, n):
    if method == "natural_neighbour":
        pytest.importorskip("startinpy")
    vertices = np.column_stack([np.arange(float(n)), np.zeros(n), np.full(n, 7.0)])
    assert elevations(vertices, method) == pytest.approx(7.0)
