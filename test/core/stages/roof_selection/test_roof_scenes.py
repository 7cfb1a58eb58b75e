"""The roof scenes themselves: their truth is what they say, and they can be made again."""

import numpy as np
import pytest

from bench.scenes.roof_site import GROUND, OBJECT, Box, Disc, Hollow, RoofSite
from bench.scenes.roofs import ROOF_SCENES

MOST_POINTS = 60_000
#: What the parametrised tests make of each scene: a quarter of its points.
THINNER = 4
#: Scene → area of its roofs in plan [m²], as drawn.
ROOF_AREA = {
    "parapet_roofs": 22 * 14 + 18 * 18 + 20 * 12 + 24 * 10,
    "step_roofs": 5 * 9 * 16 + 4 * 40 * 3 + 40 * 4,
    "facades": 3 * 44 * 12,
    "bridges": 4 * 13 * 9,
    "vehicles": 24 * 14 + 14 * 9,
    "trees_over_roofs": 6 * 12 * 8,
}


def made(name, **arguments):
    """Make a scene at a quarter of its own density."""
    scene = ROOF_SCENES[name]
    arguments.setdefault("density", scene.__kwdefaults__["density"] / THINNER)
    return scene(**arguments)


@pytest.mark.parametrize("name", ROOF_SCENES)
def test_every_scene_is_small_finite_and_has_buildings_and_ground(name):
    scene = ROOF_SCENES[name]()
    n = len(scene.points)
    assert 10_000 < n <= MOST_POINTS
    assert np.isfinite(scene.points).all()
    for column in (*scene.columns.values(), scene.is_building, scene.is_facade, scene.is_judged):
        assert len(column) == n
        assert np.isfinite(column).all()
    assert (scene.columns["classification"] == 2).sum() > 1000
    assert scene.is_building.sum() > 100
    # By the convention of the scenes, but for a roof that the hill behind it reaches.
    low = scene.is_building & (scene.columns["height_above_ground"] < 2.0)
    assert (low.sum() == 0) or name == "hillside"
    assert not (scene.is_building & (scene.columns["classification"] == 2)).any()
    assert scene.is_judged[scene.is_building | scene.is_facade].all()


@pytest.mark.parametrize(("name", "area"), ROOF_AREA.items())
def test_roofs_have_as_many_points_as_their_area_gives_pulses(name, area):
    density = ROOF_SCENES[name].__kwdefaults__["density"]
    n_building = ROOF_SCENES[name]().is_building.sum()
    # Walls take a strip of pulses beside each roof, trees over roofs some of theirs.
    assert 0.85 * density * area < n_building < 1.05 * density * area


def test_a_scene_without_returns_has_the_same_points():
    bare, full = made("without_returns"), made("trees_over_roofs")
    np.testing.assert_array_equal(bare.points, full.points)
    assert set(full.columns) - set(bare.columns) == {"return_number", "number_of_returns", "intensity"}


def site_with_box(density=30.0, height=8.0, **arguments):
    """A box of 10 × 10 m."""
    site = RoofSite(30, 30, density, 0)
    box = Box(15, 15, 10, 10)
    site.put(box, GROUND + height)
    return site.scanned(0.0, 0.0, **arguments), box


def test_pulses_at_the_rim_of_a_roof_have_two_returns_and_those_within_one():
    scene, box = site_with_box(max_angle_deg=0.0)
    depth = box.depth(*scene.points[:, :2].T)
    number, of = scene.columns["return_number"], scene.columns["number_of_returns"]
    rim, inner = scene.is_building & (depth < 0.15), scene.is_building & (depth > 0.25)
    assert (of[rim] == 2).mean() > 0.2
    assert (number[rim] == 1).mean() > 0.9
    assert (of[inner] == 1).all()
    # What is last of two lies on the ground beside or at the foot of the wall.
    assert (scene.columns["height_above_ground"][number == 2] < 1).all()


def test_leaning_beams_meet_walls_on_both_sides_and_see_each_shadow_from_one():
    scene, box = site_with_box(max_angle_deg=20.0)
    x, y, z = scene.points.T
    assert scene.is_facade.sum() > 200
    # A return of a footprint's rim is placed on its axis.
    assert (abs(box.depth(x, y))[scene.is_facade] < 0.21).all()
    assert (abs(z[scene.is_building] - GROUND - 8) < 0.01).all()
    middle, ground = abs(x - 15) < 4, scene.columns["classification"] == 2
    for edge, outward in ((10, -1), (20, 1)):
        assert (scene.is_facade & (abs(y - edge) < 0.3)).sum() > 100
        beside = (middle & ground & (abs(y - edge - outward) < 0.5)).sum()
        far_off = (middle & ground & (abs(y - edge - 5 * outward) < 0.5)).sum()
        assert 0.4 < beside / far_off < 0.9


def test_leaves_are_no_building_and_give_several_returns():
    site = RoofSite(30, 30, 20.0, 0)
    site.tree(15, 15, 6, 14)
    scene = site.scanned(0.0, 0.0)
    above = scene.columns["height_above_ground"] > 1
    assert above.sum() > 1000
    assert not scene.is_building.any()
    assert (scene.columns["number_of_returns"][above] > 1).mean() > 0.7
    distance = np.hypot(*(scene.points[above, :2] - 15).T)
    assert distance.max() < 6.01


def test_returns_of_a_pulse_are_numbered_downwards_and_lie_apart():
    scene = made("trees_over_roofs", noise=0.0)
    number, of = scene.columns["return_number"], scene.columns["number_of_returns"]
    later = np.flatnonzero(number[1:] > 1) + 1
    assert (number[later] == number[later - 1] + 1).all()
    assert (of[later] == of[later - 1]).all()
    assert (scene.points[later - 1, 2] - scene.points[later, 2] >= 1.2 - 1e-9).all()
    assert of.max() <= 5


def test_a_courtyard_is_ground_and_what_is_higher_hides_what_is_lower():
    site = RoofSite(30, 30, 10.0, 0)
    site.put(Hollow(Box(15, 15, 20, 20), Disc(15, 15, 5)), GROUND + 9)
    site.put(Box(15, 24, 4, 4), GROUND + 3, OBJECT)
    scene = site.scanned(0.0, 0.0, max_angle_deg=0.0)
    inside = np.hypot(*(scene.points[:, :2] - 15).T) < 4.5
    assert (scene.columns["classification"][inside] == 2).all()
    hidden = Box(15, 23.5, 3, 2).depth(*scene.points[:, :2].T) > 0
    assert scene.is_building[hidden].all()
