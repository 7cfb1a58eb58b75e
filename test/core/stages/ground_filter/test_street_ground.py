"""Ground as a scanner on the street sees it: what hides it, what stands on it, and where it goes on."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lidar_buildings.core.neighbours.cell_grid import rows_by_cell
from lidar_buildings.core.stages.ground_filter.classification import classify_ground
from lidar_buildings.core.stages.ground_filter.street_ground import street_ground

#: How high the scanner stands over the middle of the street, and the kerb beside it [m].
MAST, KERB = 1.9, 0.14
#: Vertical faces: x of both ends and y, and their lower and upper edge above the ground [m]: a wall, and the
#: side of a car that hides its foot and the ground before it.
FACES = {"wall": (-12.0, 18.0, 9.0, 0.0, 3.0), "car": (2.0, 6.5, 3.0, 0.25, 1.4)}
BEAMS, DIRECTIONS, PLACES = 40, 900, (-3.0, 0.0, 3.0)


@pytest.fixture(scope="module", params=[0.0, 0.15], ids=["level", "steep"])
def street(request: pytest.FixtureRequest) -> tuple[NDArray[np.float64], dict[str, NDArray[np.bool_]]]:
    """What rays from three places hit of a street that rises along x, and what each of them is."""
    draw = np.random.default_rng(0)
    down = np.repeat(np.deg2rad(np.linspace(-8.0, 25.0, BEAMS)), DIRECTIONS)
    around = np.tile(np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False), BEAMS)
    ray = np.column_stack([np.cos(around), np.sin(around), -np.tan(down)])
    points, kinds = [], []
    for place in PLACES:
        with np.errstate(divide="ignore", invalid="ignore"):
            to_road = MAST / -ray[:, 2]
            to_side = (MAST - KERB) / -ray[:, 2]
            road, side = (np.where(one > 0.0, one, np.inf) for one in (to_road, to_side))
            is_road = np.abs(road * ray[:, 1]) <= 4.0
            is_kerb = ~is_road & (np.abs(side * ray[:, 1]) < 4.0)
            away = np.where(is_road, road, np.where(is_kerb, 4.0 / np.abs(ray[:, 1]), side))
            kind = np.where(away <= 30.0, "ground", "")
            away = np.where(away <= 30.0, away, np.inf)
            for name, (left, right, y, low, high) in FACES.items():
                at = y / ray[:, 1]
                x, z = place + at * ray[:, 0], MAST + at * ray[:, 2] - (KERB if y > 4.0 else 0.0)
                is_hit = (at > 0.0) & (at < away) & (left < x) & (x < right) & (low < z) & (z < high)
                away, kind = np.where(is_hit, at, away), np.where(is_hit, name, kind)
        hit = np.isfinite(away)
        own = away[hit, None] * ray[hit] + [place, 0.0, MAST]
        points.append(own + [0.0, 0.0, request.param] * own[:, :1] + draw.normal(0.0, 0.008, own.shape))
        kinds.append(kind[hit])
    kind = np.concatenate(kinds)
    return np.concatenate(points), {name: kind == name for name in ("ground", *FACES)}


def test_ground_is_kept_with_its_kerb_and_what_stands_on_it_is_none(street):
    points, kinds = street
    result = classify_ground(points, from_street=np.ones(len(points), dtype=bool))
    found = result.classification == 2
    assert found[kinds["ground"]].mean() > 0.995
    above = result.height_above_ground > 0.3
    for name in FACES:
        assert not found[kinds[name] & above].any()
        assert found[kinds[name]].mean() < 0.03
    # The wall over the car is the first that is seen there: it is as high as it stands above the road.
    behind = kinds["wall"] & (points[:, 0] > 5.0) & (points[:, 0] < 14.0)
    low = (points[:, 2] - points[:, 0] * np.polyfit(*points[kinds["ground"]][:, [0, 2]].T, 1)[0])[behind]
    np.testing.assert_allclose(result.height_above_ground[behind], low - KERB, atol=0.15)


def test_points_from_above_are_judged_as_without_those_from_the_street(street):
    points, kinds = street
    random = np.random.default_rng(1)
    xy = random.uniform(-30.0, 30.0, (4000, 2))
    slope = np.polyfit(*points[kinds["ground"]][:, [0, 2]].T, 1)[0]
    above = np.column_stack([xy, slope * xy[:, 0] + np.where(np.abs(xy[:, 1]) > 4.0, KERB, 0.0)])
    above[(np.abs(xy - [0.0, 15.0]) < [8.0, 5.0]).all(axis=1), 2] += 6.0
    alone = classify_ground(above)
    from_street = np.repeat([False, True], [len(above), len(points)])
    both = classify_ground(np.vstack([above, points]), from_street=from_street)
    np.testing.assert_array_equal(both.classification[: len(above)], alone.classification)
    np.testing.assert_allclose(
        both.height_above_ground[: len(above)], alone.height_above_ground, rtol=0.0, atol=0.2
    )
    none = classify_ground(above, from_street=np.zeros(len(above), dtype=bool))
    np.testing.assert_array_equal(none.height_above_ground, alone.height_above_ground)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_a_few_points_have_a_terrain(n):
    points = np.random.default_rng(n).uniform(0.0, 10.0, (n, 3))
    result = classify_ground(points, from_street=np.ones(n, dtype=bool))
    assert np.isfinite(result.height_above_ground).all()
    assert (result.classification == 2).any()


def test_the_order_of_points_does_not_matter(street):
    points, _ = street
    rows = np.random.default_rng(2).permutation(len(points))
    one, other = (
        classify_ground(each, from_street=np.ones(len(each), bool)) for each in (points, points[rows])
    )
    np.testing.assert_array_equal(one.classification[rows], other.classification)


def test_ground_ends_where_a_wall_has_as_many_points():
    random = np.random.default_rng(3)
    ground, wall = random.normal(0.0, 0.02, 400), random.uniform(0.0, 0.8, 800)
    height = np.concatenate([ground, wall])
    points = np.column_stack([random.uniform(0.0, 0.5, (len(height), 2)), height])
    cells = rows_by_cell(points, 1.0)
    found = np.empty(len(height), dtype=bool)
    found[cells.rows] = street_ground(cells, np.ones(len(height), dtype=bool), height[cells.rows], 0.25)
    assert found[:400].mean() > 0.95
    assert not found[400:][wall > 0.12].any()
    assert not street_ground(cells, np.zeros(len(height), dtype=bool), height[cells.rows], 0.25).any()
