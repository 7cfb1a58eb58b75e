"""The terrain scenes themselves: their truth is what they say, and they can be made again."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from bench.scenes.terrain import TERRAIN_SCENES
from bench.scenes.terrain_site import GROUND, TerrainSite

MOST_POINTS = 60_000
#: What the parametrised tests make of each scene: a quarter of its points.
THINNER = 4

#: Scene → share of ground, as counted from areas: what is built or grown, and what the scene covers.
GROUND_SHARE = {
    "large_hall": 1 - 120 * 60 / (200 * 140),
    "garage_ramp": 1 - 40 * 30 / (100 * 90),
    "bridge_over_cut": 1 - 36 * 9 / (140 * 120),
    "overpass_with_ramps": 1 - 24 * 10 / (220 * 80),
    "steep_forest": 0.20,
    "city_block": 1 - 4 * (52 * 50 - 6 * 24 - 6 * 10) / (135 * 130),
}


def made(name, **arguments):
    """Make a scene at a quarter of its own density."""
    scene = TERRAIN_SCENES[name]
    arguments.setdefault("density", scene.__kwdefaults__["density"] / THINNER)
    return scene(**arguments)


@pytest.mark.parametrize("name", TERRAIN_SCENES)
def test_every_scene_is_small_finite_and_has_ground_and_objects(name):
    points, is_ground = TERRAIN_SCENES[name]()
    assert points.shape == (len(is_ground), 3)
    assert points.dtype == np.float64
    assert is_ground.dtype == bool
    assert 10_000 < len(points) <= MOST_POINTS
    assert np.isfinite(points).all()
    assert is_ground.sum() > 1000
    assert (~is_ground).sum() > 50


@pytest.mark.parametrize(("name", "share"), GROUND_SHARE.items())
def test_the_share_of_ground_is_that_of_the_areas(name, share):
    assert TERRAIN_SCENES[name]().is_ground.mean() == pytest.approx(share, abs=0.006)


@pytest.mark.parametrize("name", sorted(set(TERRAIN_SCENES) - {"low_outliers", "hall_in_hillside"}))
def test_objects_lie_above_the_ground_and_never_in_it(name):
    points, is_ground = made(name, noise=0.0)
    tree = cKDTree(points[is_ground, :2])
    _, nearest = tree.query(points[~is_ground, :2], k=3)
    above = points[~is_ground, 2] - points[is_ground, 2][nearest].min(axis=1)
    assert np.median(above) > 0.4
    assert (above > 0).mean() > 0.9


def test_gross_errors_lie_far_below_in_groups_of_one_to_sixty():
    points, is_ground = TERRAIN_SCENES["low_outliers"](noise=0.0)
    surface = cKDTree(points[is_ground, :2])
    gap = points[:, 2] - points[is_ground, 2][surface.query(points[:, :2])[1]]
    errors = gap < -1.5
    assert errors.sum() == 2 * (1 + 1 + 1 + 2 + 3 + 5 + 8 + 13 + 20 + 35 + 60)
    assert not is_ground[errors].any()
    assert gap[errors].min() > -12


def test_a_solid_body_is_not_seen_where_the_terrain_is_higher():
    site = TerrainSite(40, 40, 2.0, 0, lambda x, y: 0.2 * y)
    site.put(site.box(20, 20, 20, 20), GROUND + 4.0, walls=False)
    scene = site.scanned(0.0, 0.0)
    roof = ~scene.is_ground
    assert scene.points[roof, 1].max() <= 20
    np.testing.assert_array_equal(scene.points[roof, 2], GROUND + 4.0)
