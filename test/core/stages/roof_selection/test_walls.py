"""Walls of buildings are façade where no roof was seen, as from the street; what is lower or rough is not."""

import numpy as np
import pytest

from lidar_buildings.core.model.classes import FacadeClass, PointClass
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.facades import wall_areas
from lidar_buildings.core.stages.roof_selection.selection import select_roofs

GROUND, BUILDING = PointClass.GROUND, PointClass.BUILDING
#: Name of a wall → length and height [m], and whether it is a building's.
WALLS = {
    "two storeys": (10.0, 6.0, True),
    "a tower": (4.0, 15.0, True),
    "a lorry": (12.0, 3.8, False),
    "a garden wall": (40.0, 2.2, False),
    "a pillar": (1.5, 12.0, False),
}


def wall(random, length, height, turned=0.3, noise=0.02, density=40):
    """Points of an upright rectangle that begins at (0, 0) on the ground."""
    n = int(density * length * height)
    along, z = random.uniform(0.0, length, n), random.uniform(0.0, height, n)
    across = random.normal(0.0, noise, n)
    c, s = np.cos(turned), np.sin(turned)
    return np.column_stack([along * c - across * s, along * s + across * c, z])


def street(random, things):
    """Put things side by side on level ground; return all points, their heights, and what each is of."""
    ground = np.column_stack([random.uniform(-20.0, 60.0, (20_000, 2)), np.zeros(20_000)])
    points = [ground, *(one + np.array([0.0, 15.0 * k, 0.0]) for k, one in enumerate(things))]
    of = np.repeat(np.arange(-1, len(things)), [len(one) for one in points])
    return np.concatenate(points), of


def selected(points, order=None, **config):
    order = np.arange(len(points)) if order is None else order
    classes = np.where(points[:, 2] < 0.05, GROUND, 1).astype(np.uint8)
    result = select_roofs(
        points[order],
        RoofSelectionConfig(**config),
        height_above_ground=points[order, 2],
        classification=classes[order],
        point_spacing=0.2,
    )
    return result.classification[np.argsort(order)], result.is_facade[np.argsort(order)]


@pytest.mark.parametrize("min_area", [12.0, 0.0])
@pytest.mark.parametrize("name", WALLS)
def test_walls_as_large_as_a_buildings_are_facade(name, min_area):
    length, height, is_building = WALLS[name]
    points, of = street(np.random.default_rng(1), [wall(np.random.default_rng(2), length, height)])
    classes, is_facade = selected(points, min_building_area=min_area)
    raised = (of == 0) & (points[:, 2] > 1.0)
    assert np.mean(is_facade[raised]) == pytest.approx(float(is_building), abs=0.02)
    np.testing.assert_array_equal(classes[of == 0] == BUILDING, is_facade[of == 0])
    assert not is_facade[of < 0].any()


def test_crowns_and_hedges_are_none_whatever_their_size():
    random = np.random.default_rng(3)
    crown = random.normal(0.0, 1.0, (4000, 3))
    crown *= 4.0 * random.uniform(0.6, 1.0, (4000, 1)) ** (1 / 3) / np.linalg.norm(crown, axis=1)[:, None]
    hedge = wall(random, 30.0, 6.0, noise=0.35)
    points, of = street(random, [crown + np.array([0.0, 0.0, 6.0]), hedge])
    classes, is_facade = selected(points)
    assert not is_facade.any()
    assert (classes[(of >= 0) & (points[:, 2] > 5.0)] == PointClass.HIGH_VEGETATION).all()


def test_what_hangs_beside_a_wall_below_its_top_is_facade_too():
    random = np.random.default_rng(4)
    front = wall(random, 10.0, 6.0, turned=0.0)
    sill = np.column_stack([random.uniform(2.0, 3.0, 80), random.uniform(-0.3, 0.0, 80), np.full(80, 3.0)])
    ball = random.uniform(-0.5, 0.5, (200, 3)) + np.array([5.0, -3.0, 4.0])
    points, _ = street(random, [np.concatenate([front, sill, ball])])
    _, is_facade = selected(points)
    n = len(points)
    assert is_facade[n - 280 : n - 200].mean() > 0.9
    assert not is_facade[n - 200 :].any()


def test_a_bush_before_a_wall_is_vegetation():
    random = np.random.default_rng(7)
    bush = random.uniform((2.0, -2.0, 0.5), (5.0, -0.4, 3.0), (800, 3))
    points, _ = street(random, [np.concatenate([wall(random, 10.0, 6.0, turned=0.0), bush])])
    classes, is_facade = selected(points)
    assert is_facade[-800:].mean() < 0.02
    assert is_facade[points[:, 2] > 3.5].all()
    assert np.isin(classes[-800:], (PointClass.LOW_VEGETATION, PointClass.MEDIUM_VEGETATION)).mean() > 0.98


def test_without_facades_and_by_other_methods_walls_are_not_told():
    points, of = street(np.random.default_rng(1), [wall(np.random.default_rng(2), 10.0, 6.0)])
    for config in ({"facade_reach": 0.0}, {"method": "lasclassify"}):
        classes, is_facade = selected(points, **config)
        assert not is_facade.any()
        assert not (classes[of == 0] == BUILDING).any()


def test_the_order_of_points_does_not_matter():
    random = np.random.default_rng(5)
    points, _ = street(random, [wall(random, *WALLS[name][:2]) for name in WALLS])
    first, second = (selected(points, order) for order in (None, random.permutation(len(points))))
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])


@pytest.mark.parametrize("turned", [0.0, 0.7, 1.6])
def test_areas_are_length_times_height(turned):
    random = np.random.default_rng(6)
    parts = [
        wall(random, *size, turned=turned) for size in ((10.0, 6.0), (4.0, 12.0), (2.0, 9.0), (9.0, 2.0))
    ]
    label = np.repeat(np.arange(4), [len(one) for one in parts])
    order = random.permutation(len(label))
    areas = wall_areas(np.concatenate(parts)[order], label[order], 3.0)
    np.testing.assert_allclose(areas, [60.0, 48.0, 0.0, 0.0], rtol=0.05)


def test_walls_below_a_roof_are_told_from_bare_ones():
    random = np.random.default_rng(9)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0.0, 10.0, 0.2), np.arange(0.0, 6.0, 0.2)))
    roof = np.column_stack([x, y, np.full(len(x), 6.05)])
    front = wall(random, 20.0, 6.0, turned=0.0)
    points, of = street(random, [np.concatenate([roof, front])])
    result = select_roofs(
        points,
        height_above_ground=points[:, 2],
        classification=np.where(points[:, 2] < 0.05, GROUND, 1),
        point_spacing=0.2,
    )
    own, x = result.facade[of == 0][len(roof) :], points[of == 0][len(roof) :, 0]
    raised = points[of == 0][len(roof) :, 2] > 1.0
    assert np.mean(own[raised & (x > 12.0)] == FacadeClass.BARE) > 0.98
    assert np.mean(own[raised & (x < 9.0)] == FacadeClass.BELOW_ROOF) > 0.9
    assert not (own[raised & (x < 9.0)] == FacadeClass.BARE).any()
    assert not result.facade[of == 0][: len(roof)].any()


def test_a_place_that_was_measured_a_thousand_times_changes_nothing_elsewhere():
    random = np.random.default_rng(6)
    points, of = street(random, [wall(random, 10.0, 6.0), wall(random, 12.0, 3.8)])
    again = random.normal(0.0, 0.02, (40_000, 3)) + points[of == 0][random.integers(0, 40, 40_000)]
    crowd = again[again[:, 2] > 0.05]
    alone, is_facade = selected(points)
    classes, is_facade_too = selected(np.vstack([points, crowd]))
    np.testing.assert_array_equal(classes[: len(points)], alone)
    np.testing.assert_array_equal(is_facade_too[: len(points)], is_facade)
    assert (classes[len(points) :][crowd[:, 2] > 1.0] == BUILDING).all()
