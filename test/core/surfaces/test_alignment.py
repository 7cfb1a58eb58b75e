"""A cloud from the street laid on one from above."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lidar_buildings.core.surfaces.alignment import Alignment, align, height_offset

#: South-west corners of houses of 10 × 8 m, turned by so many degrees, and their height [m].
HOUSES, EAVE = ((0.0, 8.0, 0.0), (18.0, 9.0, 25.0), (2.0, -16.0, -10.0), (22.0, -15.0, 5.0)), 6.0

FAR = np.array([500.0, 0.0, 0.0])


def walls(n: int, draw: np.random.Generator) -> NDArray[np.float64]:
    """Return points on the walls of the houses, as many on each wall [m]."""
    parts = []
    for x, y, turn in HOUSES:
        angle = np.deg2rad(turn)
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        for start, way, length in (
            ((x, y), along, 10.0),
            ((x, y), across, 8.0),
            ((x, y) + 8.0 * across, along, 10.0),
            ((x, y) + 10.0 * along, across, 8.0),
        ):
            plan = np.array(start) + draw.uniform(0.0, length, (n, 1)) * way
            parts.append(np.column_stack([plan, draw.uniform(0.0, EAVE, n)]))
    return np.concatenate(parts)


def ground(n: int, draw: np.random.Generator) -> NDArray[np.float64]:
    """Return points on the ground about the houses, which slopes a little [m]."""
    plan = draw.uniform((-5.0, -22.0), (38.0, 25.0), (n, 2))
    return np.column_stack([plan, 0.02 * plan[:, 0]])


@pytest.fixture(scope="module")
def above() -> NDArray[np.float64]:
    """The houses from above: ground, few points on walls, roofs above these."""
    draw = np.random.default_rng(1)
    tops = walls(200, draw)
    tops[:, 2] = EAVE + 0.5
    points = np.concatenate([ground(15_000, draw), walls(40, draw), tops])
    return points + 0.02 * draw.standard_normal(points.shape)


@pytest.fixture(scope="module")
def street() -> NDArray[np.float64]:
    """The houses from the street, much denser."""
    draw = np.random.default_rng(2)
    points = np.concatenate([ground(15_000, draw), walls(2_500, draw)])
    return points + 0.01 * draw.standard_normal(points.shape)


@pytest.mark.parametrize(("shift", "yaw"), [((0.8, -0.6, 0.4), 1.0), ((-1.5, 1.0, 35.0), -0.7)])
def test_a_shifted_and_turned_cloud_comes_back(
    above: NDArray[np.float64], street: NDArray[np.float64], shift: tuple[float, ...], yaw: float
) -> None:
    pivot = np.median(street[:, :2], axis=0)
    moved = Alignment(pivot, np.deg2rad(yaw), np.array(shift), 0.0, 0, 0.0, 0, 0.0).moved(street)

    found = align(moved, above)

    assert found is not None
    assert found.plan_error < 0.02
    assert found.rms_ground < 0.05
    assert np.abs(found.moved(moved) - street).max() < 0.05


def test_without_walls_heights_alone_are_aligned(above: NDArray[np.float64]) -> None:
    draw = np.random.default_rng(3)
    flat = ground(15_000, draw)

    found = align(flat + np.array([0.5, 0.5, 2.0]), above)

    assert found is not None
    assert np.isinf(found.plan_error)
    assert found.yaw == 0.0
    np.testing.assert_array_equal(found.shift[:2], 0.0)
    assert found.shift[2] == pytest.approx(-2.0, abs=0.05)


def test_clouds_apart_share_no_ground(above: NDArray[np.float64], street: NDArray[np.float64]) -> None:
    assert height_offset(street + FAR, above)[2] == 0
    assert align(street + FAR, above) is None
