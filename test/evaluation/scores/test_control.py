"""A result against a sharper cloud: known offsets come out, however dense the points lie."""

import numpy as np
import pytest

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.raising import extrude
from lidar_buildings.evaluation.scores.control import score_control, terrain_differences

#: A box of 12 × 8 × 6 m, turned and far from the origin.
TURN = np.array([[np.cos(0.5), np.sin(0.5)], [-np.sin(0.5), np.cos(0.5)]])
PLACE, SIZE, HEIGHT = np.array([84_000.0, 447_000.0]), np.array([12.0, 8.0]), 6.0
CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * SIZE
MODEL = (extrude(Outline(CORNERS @ TURN + PLACE, ()), 2.0, 2.0 + HEIGHT),)


def shell(inset, lowered, seed=0, noise=0.005):
    """Points of a box whose walls lie so far inside the model's, whose roof is so much lower."""
    random = np.random.default_rng(seed)
    # one wall twice as dense, the last one not seen
    walls = [
        ([inset, inset], [1.0, 0.0], SIZE[0] - 2 * inset, 8000),
        ([SIZE[0] - inset, inset], [0.0, 1.0], SIZE[1] - 2 * inset, 16000),
        ([inset, SIZE[1] - inset], [1.0, 0.0], SIZE[0] - 2 * inset, 8000),
    ]
    parts = []
    for start, along, length, n in walls:
        at, z = random.uniform(0.0, length, (n, 1)), random.uniform(2.0, 8.0 - lowered, n)
        parts.append(np.column_stack([np.array(start) + at * along, z]))
    roof = random.uniform((inset, inset), SIZE - inset, (8000, 2))
    parts.append(np.column_stack([roof, np.full(len(roof), 8.0 - lowered)]))
    points = np.concatenate(parts) + random.normal(0.0, noise, (40000, 3))
    return np.column_stack([points[:, :2] @ TURN + PLACE, points[:, 2]])


def test_walls_and_roofs_that_lie_outside_the_cloud_are_told_by_how_much():
    found = score_control([MODEL], shell(0.12, 0.08))
    assert found["wall_bias"] == pytest.approx(0.12, abs=0.005)
    assert found["wall_median"] == pytest.approx(0.12, abs=0.005)
    assert found["wall_rmse"] == pytest.approx(0.12, abs=0.01)
    assert found["roof_bias"] == pytest.approx(0.08, abs=0.005)
    assert found["roof_percentile_90"] == pytest.approx(0.08, abs=0.01)
    assert found["wall_seen"] == pytest.approx(32.0 / 40.0, abs=0.03)
    assert 300 < found["roof_n_cells"] < 520


def test_what_lies_far_from_a_wall_or_across_it_is_none_of_it():
    random = np.random.default_rng(0)
    across = np.column_stack([np.full(4000, 6.0), *random.uniform((-0.8, 2.0), (-0.1, 8.0), (4000, 2)).T])
    far = across[:, [1, 0, 2]] + (6.0, -9.0, 0.0)
    points = np.concatenate([across, far])
    points[:, :2] = points[:, :2] @ TURN + PLACE
    found = score_control([MODEL], points)
    assert (found["wall_n_cells"], found["wall_seen"]) == (0, 0.0)
    assert np.isnan(found["wall_median"])


def test_the_terrain_is_compared_cell_by_cell_where_it_is_known():
    rows, columns = np.mgrid[0:20, 0:30].astype(float)
    dtm = 0.1 * rows - 0.05 * columns + 1.0
    dtm[:, 20:] = np.nan
    random = np.random.default_rng(0)
    places = np.concatenate(
        [random.uniform((0.0, 0.0), (19.0, 29.0), (3000, 2)), random.uniform(3.0, 4.0, (9000, 2))]
    )
    z = 0.1 * places[:, 0] - 0.05 * places[:, 1] + 1.0
    # a thousand points of one cell, or of few, weigh no more than its own
    z[3000:] += 0.5
    off = terrain_differences(dtm, places, z - 0.04)
    assert np.median(off) == pytest.approx(0.04, abs=1e-9)
    assert (off < 0.0).mean() < 0.02
    assert 350 < len(off) <= 400
