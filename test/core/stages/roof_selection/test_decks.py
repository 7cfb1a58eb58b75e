import numpy as np
import pytest

from bench.scenes.roofs import ROOF_SCENES
from lidar_buildings.core.stages.roof_selection.roof_patches import is_deck
from lidar_buildings.core.stages.roof_selection.selection import select_roofs


def sheet(x, y, z, step=0.5):
    """Points of z(x, y) over x from, to and y from, to."""
    a, b = np.meshgrid(np.arange(*x, step), np.arange(*y, step))
    return np.column_stack([a.ravel(), b.ravel(), np.broadcast_to(z(a, b), a.shape).ravel()])


def over_a_cut(turn_deg=0.0, far_bank=0.0, width=8.0):
    """A surface 20 m long over a cut 6 m deep, between banks of which one may be lower."""
    deck = sheet((-10, 10), (-width / 2, width / 2), lambda x, y: 0.0)
    banks = sheet((-40, 40), (-20, 20), lambda x, y: np.where(x < 0, 0.0, far_bank))
    cut = sheet((-11, 11), (-20, 20), lambda x, y: -6.0)
    ground = np.vstack([banks[abs(banks[:, 0]) > 11], cut])
    c, s = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return deck @ turn, ground @ turn


@pytest.mark.parametrize("turn_deg", [0.0, 22.5, 30.0, 77.0])
def test_a_surface_between_two_banks_at_its_level_is_a_deck(turn_deg):
    deck, ground = over_a_cut(turn_deg)
    assert is_deck(deck, np.zeros(len(deck), dtype=int), 1, ground, 0.7).tolist() == [True]


def test_a_roof_level_with_the_slope_behind_it_is_none():
    roof, ground = over_a_cut(far_bank=-3.0)
    assert not is_deck(roof, np.zeros(len(roof), dtype=int), 1, ground, 0.7).any()


@pytest.mark.parametrize("turn_deg", [0.0, 30.0])
def test_a_long_and_narrow_surface_with_one_end_on_a_bank_is_a_deck(turn_deg):
    deck, ground = over_a_cut(turn_deg, far_bank=-3.0, width=2.0)
    assert is_deck(deck, np.zeros(len(deck), dtype=int), 1, ground, 0.7).tolist() == [True]
    assert not is_deck(deck + np.array([0, 0, 2.0]), np.zeros(len(deck), dtype=int), 1, ground, 0.7).any()


def test_each_surface_is_judged_by_itself_in_any_order():
    deck, ground = over_a_cut()
    roof = deck + np.array([0, 0, 5.0])
    points, label = np.vstack([deck, roof]), np.repeat([1, 0], [len(deck), len(roof)])
    shuffle = np.random.default_rng(0).permutation(len(points))
    for rows in (slice(None), shuffle):
        assert is_deck(points[rows], label[rows], 2, ground, 0.7).tolist() == [False, True]


def test_without_ground_or_surfaces_there_are_no_decks():
    deck, ground = over_a_cut()
    none = np.zeros((0, 3))
    assert not is_deck(deck, np.zeros(len(deck), dtype=int), 1, none, 0.7).any()
    assert len(is_deck(none, np.zeros(0, dtype=int), 0, ground, 0.7)) == 0


@pytest.mark.parametrize("rotation_deg", [0.0, 30.0])
def test_the_bridge_is_no_roof_and_the_houses_beside_it_are(rotation_deg):
    scene = ROOF_SCENES["bridges"](density=6.0, rotation_deg=rotation_deg)
    found = select_roofs(scene.points, **scene.columns)
    roof = (found.classification == 6) & ~found.is_facade
    assert roof[scene.is_building].mean() > 0.98
    assert scene.is_building[roof].mean() > 0.98
