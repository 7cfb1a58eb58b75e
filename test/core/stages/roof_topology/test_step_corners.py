"""Corners of steps, moved onto the hips that end in them."""

import numpy as np
import pytest
import shapely

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.stages.roof_topology import HIP, find_topology
from lidar_buildings.core.stages.roof_topology.step_corners import onto_ridges
from lidar_buildings.core.stages.roof_topology.step_lines import StepLines

#: y = 0 from x = -5 to 0, and x = 0 from y = -5 to 0: their corner is the origin.
LINES = StepLines(
    angle=np.array([0.0, np.pi / 2]),
    offset=np.zeros(2),
    line=np.array([0, 1]),
    t=np.array([[-5.0, 0.0], [-5.0, 0.0]]),
    planes=np.ones((2, 2), dtype=np.int32),
    length=np.full(2, 5.0),
    gap=np.zeros(2),
)


def corner_of(lines):
    """x and y of the corner: the second line leads up, with its left at lower x."""
    return -lines.offset[1], lines.offset[0]


def hip(beside, end=0.0):
    """A hip along x = y from the south-west, moved to lower x and higher y, that ends at `end`."""
    return np.add([[[-3.0, -3.0], [end, end]]], (-beside / 2, beside / 2))


@pytest.mark.parametrize(
    ("bound", "expected"),
    [
        ((False, False), (-0.1, 0.1)),
        ((True, False), (-0.2, 0.0)),
        ((False, True), (0.0, 0.2)),
        ((True, True), (0.0, 0.0)),
    ],
)
def test_a_corner_moves_onto_a_hip_by_the_lines_that_are_free(bound, expected):
    moved = onto_ridges(LINES, np.array(bound), hip(0.2), 1.0)
    assert corner_of(moved) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("ridges", [hip(1.2), hip(0.2, end=-2.8), np.zeros((0, 2, 2)), np.zeros((1, 2, 2))])
def test_corners_stay_where_no_hip_ends_near(ridges):
    moved = onto_ridges(LINES, np.zeros(2, dtype=bool), ridges, 1.0)
    assert corner_of(moved) == pytest.approx((0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_hips_end_in_the_corners_of_eaves_over_a_lower_roof(seed):
    # A hip roof of 10 m x 8 m on the middle of a flat one.
    xy = np.random.default_rng(seed).random((4000, 2)) * (20.0, 18.0)
    x, y = np.abs(xy - (10.0, 9.0)).T
    height = np.column_stack([5.0 - x, 4.0 - y]).min(axis=1)
    plane_id = np.where(
        height < 0.0, 5, np.where(5.0 - x < 4.0 - y, 1 + (xy[:, 0] > 10.0), 3 + (xy[:, 1] > 9.0))
    )
    points = np.column_stack([xy, np.where(height < 0.0, 3.0, 6.0 + 0.7 * height)])
    outline = Outline(np.array([(0, 0), (20, 0), (20, 18), (0, 18.0)]))
    topology = find_topology(points, plane_id, outline)
    hips = [line.segment[:, :2] for line in topology.intersections if line.kind == HIP]
    corners = np.concatenate([step.segment for step in topology.steps])
    assert (len(hips), len(topology.steps)) == (4, 4)
    eaves = shapely.box(5.0, 5.0, 15.0, 13.0)
    for segment in hips:
        away = np.hypot(*(segment[:, None] - corners).T).min(axis=0)
        assert away.min() < 1e-6
        lower = shapely.Point(segment[away.argmin()])
        assert eaves.exterior.distance(lower) < 0.2
