"""Scenes of outlines: what they say of themselves is so."""

import numpy as np
import pytest
import shapely

from bench.scenes.outlines import PLANS, Scan, outline_scene, outline_scenes

CORNERS = {
    "rectangle_8_6": 4,
    "long_hall": 4,
    "facade_step": 6,
    "staircase": 12,
    "comb": 24,
    "cross": 12,
    "two_courtyards": 12,
    "l_with_courtyard": 10,
    "three_wings": 10,
    "octagon": 8,
    "plot_filling": 5,
    "round_tower_8": None,
}


@pytest.mark.parametrize("name", PLANS)
def test_a_truth_is_a_valid_oriented_polygon_with_the_density_asked_for(name):
    scene = outline_scene(name, rotation_deg=52.5)
    assert scene.truth.is_valid
    assert shapely.is_ccw(scene.truth.exterior)
    assert not any(shapely.is_ccw(hole) for hole in scene.truth.interiors)
    n_expected = 8.0 * scene.truth.area
    # The number of places inside a jittered grid varies less than at random.
    assert abs(len(scene.points) - n_expected) < 3 * n_expected**0.5
    assert shapely.distance(scene.truth, shapely.points(scene.points[:, :2])).max() < 0.2


@pytest.mark.parametrize(("name", "n_corners"), CORNERS.items())
def test_corners_are_those_of_the_plan(name, n_corners):
    assert outline_scene(name, rotation_deg=37.5).n_corners == n_corners


@pytest.mark.parametrize("density", [0.2, 15.0])
def test_all_plans_can_be_scanned_at_any_density(density):
    scenes = outline_scenes(density, rotations=(0.0,))
    assert [scene.name for scene in scenes] == list(PLANS)
    assert min(len(scene.points) for scene in scenes) > 0.5 * 48 * density


def test_scan_lines_have_the_direction_and_spacing_asked_for():
    scan = Scan(direction_deg=30.0, anisotropy=2.0, jitter=0.0)
    scene = outline_scene("rectangle_30_18", density=2.0, noise=0.0, scans=[scan])
    turn = np.deg2rad(30.0)
    across = scene.points[:, :2] @ (-np.sin(turn), np.cos(turn))
    lines = np.unique(np.round(across, 6))
    # 2 pts/m² with lines twice as far apart as their points: 1.0 m between lines, 0.5 m along them.
    np.testing.assert_allclose(np.diff(lines), 1.0, atol=1e-5)
