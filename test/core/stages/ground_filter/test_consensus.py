import functools

import laspy
import numpy as np
import pytest
from support.lattice import lattice

from bench.scenes.terrain import TERRAIN_SCENES
from lidar_buildings.core.stages.ground_filter import consensus
from lidar_buildings.core.stages.ground_filter.classification import classify_ground
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig
from lidar_buildings.core.stages.ground_filter.progressive_tin import GROUND_DISTANCE_SLOPE, MAX_SLOPE
from lidar_buildings.evaluation.scores.cells import score_ground

CONFIG = GroundFilterConfig()

#: Scene → most points with the wrong label [%], some above what is measured over rotations and seeds.
LARGEST_ERROR = {
    # Walls, roofs, cars, dykes and cliffs: nothing but single points at the foot of a wall.
    "large_hall": 0.1,
    "city_block": 0.1,
    "motorway_embankment": 0.1,
    "sparse_suburb": 0.1,
    "dense_street": 0.2,
    "quarry": 0.2,
    "river_bank": 0.2,
    "lake_gap": 0.1,
    "strip_edges": 0.5,
    "low_outliers": 0.1,
    "dyke_and_mound": 0.1,
    "low_walls_and_hedges": 0.2,
    # Decks that continue the road on both sides: two of the three views climb them.
    "bridge_over_cut": 1.9,
    "overpass_with_ramps": 1.3,
    # Ground at the foot of walls is spanned by facets that come down from the top.
    "garage_ramp": 0.4,
    "houses_on_hillside": 1.1,
    # Terraces behind walls, lost where a row of vines stands at their rim.
    "terraced_vineyard": 3.0,
    # Boulders of 2 m amid bare rock are taken for rock: nothing tells them from small rises.
    "mountain_ridge": 2.5,
    # The roof, 11 % of the points, meets the hill without a step at its back: it is climbed from there.
    "hall_in_hillside": 12.0,
    # A fifth of the points is ground, on slopes on which the tolerance is as high as the undergrowth.
    "steep_forest": 17.0,
}
#: Largest total error over the ISPRS samples at hand, and their mean [%].
ISPRS_WORST, ISPRS_MEAN = 9.0, 3.2


def is_ground(points, config=CONFIG):
    """Which points `classify_ground` calls ground."""
    return classify_ground(points, config).classification == 2


@functools.cache
def error_on(name, **arguments):
    """Points of a scene with the wrong label [%]."""
    scene = TERRAIN_SCENES[name](**arguments)
    return 100 * np.mean(is_ground(scene.points) != scene.is_ground)


@pytest.mark.parametrize("name", TERRAIN_SCENES)
def test_the_error_on_each_terrain_scene_stays_within_what_is_known_of_it(name):
    assert error_on(name) <= LARGEST_ERROR[name]


def test_the_mean_error_over_the_scenes_is_small():
    errors = [error_on(name) for name in TERRAIN_SCENES]
    assert np.mean(errors) < 1.8
    assert np.median(errors) < 0.1


@pytest.mark.parametrize(("spacing", "height"), [(0.8, 4.0), (1.6, 6.0), (2.4, 8.0)])
def test_a_narrow_bank_of_45_degrees_is_ground_in_sparse_clouds_as_well(spacing, height):
    points = lattice(120.0, 120.0, spacing, is_centred=True)
    points[:, 2] += np.clip(height + 5.0 - abs(0.8 * points[:, 0] - 0.6 * points[:, 1]), 0.0, height)
    # By the majority alone 100, 96 and 91 %: profiles and openings take what is as narrow for an object.
    assert is_ground(points).mean() > 0.998


def test_a_terrace_behind_a_cliff_is_ground_up_to_its_rim():
    points = lattice(120.0, 120.0, is_centred=True)
    edge = 6.0 * np.sin(points[:, 0] / 15.0)
    points[points[:, 1] > edge, 2] += 9.0
    found = is_ground(points)
    # Points within a cell of the rim lie above a facet that comes up from the foot.
    assert found[(points[:, 1] > edge + 1.0) | (points[:, 1] < edge - 1.0)].mean() > 0.99
    assert found[(points[:, 1] > edge) & (points[:, 1] < edge + 1.0)].mean() > 0.4


@pytest.mark.parametrize("height", [2.0, 4.0])
def test_a_mound_in_bare_land_is_ground(height):
    points = lattice(140.0, 140.0, is_centred=True)
    points[:, 2] += height * np.clip(1.5 - np.hypot(*points[:, :2].T) / 8.0, 0, 1)
    assert is_ground(points).mean() > 0.999


@pytest.mark.parametrize("angle_deg", [0.0, 27.0])
@pytest.mark.parametrize(
    ("half", "height"),
    [((5.0, 4.0), 5.0), ((15.0, 0.7), 1.6), ((1.2, 1.2), 1.4), ((2.2, 0.9), 1.5), ((30.0, 20.0), 9.0)],
    ids=["house", "hedge", "lone bush", "car", "hall"],
)
def test_what_stands_on_bare_land_in_steps_is_not_ground(half, height, angle_deg):
    angle = np.deg2rad(angle_deg)
    points = lattice(140.0, 140.0, is_centred=True)
    local = points[:, :2] @ [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    inside = (abs(local) < half).all(axis=1)
    points[inside, 2] += height
    assert inside.any()
    np.testing.assert_array_equal(is_ground(points), ~inside)


@pytest.mark.parametrize(("slope", "share"), [(0.0, 0.1), (0.2, 0.25), (0.4, 0.7)])
def test_few_bushes_are_taken_for_ground_on_level_bare_land_and_many_on_bare_hillsides(slope, share):
    points = lattice(100.0, 100.0, is_centred=True)
    bush = np.hypot(points[:, 0] % 10.0 - 5.0, points[:, 1] % 10.0 - 5.0) < 1.3
    points[:, 2] += slope * points[:, 0]
    points[bush, 2] += np.random.default_rng(0).uniform(1.0, 1.8, bush.sum())
    found = is_ground(points)
    # In open terrain what is low and meets the ground under slopes counts as a rise.
    assert found[bush].mean() < share
    assert found[~bush].all()


def test_labels_follow_from_the_distance_to_the_terrain():
    points, _ = TERRAIN_SCENES["houses_on_hillside"]()
    result = classify_ground(points)
    ground = result.classification == 2
    away = abs(result.height_above_ground)
    assert away[ground].max() <= CONFIG.ground_distance + MAX_SLOPE * GROUND_DISTANCE_SLOPE
    assert away[~ground].min() > CONFIG.ground_distance


def views_are(monkeypatch, views, beyond):
    """Put labels in the place of the three views, and what the TIN does not reach within narrow limits."""
    monkeypatch.setattr(consensus, "grown_ground", lambda *_: (views[0], beyond))
    monkeypatch.setattr(consensus, "profile_ground", lambda *_: views[1])
    monkeypatch.setattr(consensus, "opened_ground", lambda *_: views[2])


def test_two_of_three_views_decide(monkeypatch):
    views = np.array([[1, 1, 0, 0, 1], [1, 0, 1, 0, 0], [1, 1, 0, 1, 0]], dtype=bool)
    views_are(monkeypatch, views, np.zeros(5, dtype=bool))
    points = np.column_stack((50.0 * np.arange(5), np.zeros((5, 2))))
    found, _ = consensus.agreed_ground(points, np.zeros((2, 2)), 1.0, CONFIG)
    assert found.tolist() == [True, True, False, False, False]
    views[:] = False
    assert consensus.agreed_ground(points, np.zeros((2, 2)), 1.0, CONFIG)[0].all()


@pytest.mark.parametrize("view", [0, 1, 2])
@pytest.mark.parametrize(
    ("rise", "is_beyond", "expected"), [(0.5, True, True), (9.0, True, False), (0.5, False, False)]
)
def test_a_part_of_one_view_is_ground_if_it_meets_the_rest_as_terrain_does(
    monkeypatch, view, rise, is_beyond, expected
):
    points = lattice(60.0, 60.0, is_centred=True)
    part = (abs(points[:, :2]) < 8.0).all(axis=1)
    points[part, 2] += rise
    views = np.broadcast_to(~part, (3, len(points))).copy()
    views[view, part] = True
    views_are(monkeypatch, views, part & is_beyond)
    found, _ = consensus.agreed_ground(points, np.zeros((2, 2)), 1.0, CONFIG)
    assert (found[part] == expected).all()
    assert found[~part].all()


@pytest.mark.real_data
def test_one_set_of_parameters_serves_the_isprs_samples(data_folder):
    scores = {}
    for path in sorted((data_folder / "isprs").glob("samp[0-9][0-9].laz")):
        las = laspy.read(path)
        points = las.xyz - [*(np.floor(las.xyz[:, :2].min(axis=0) / 100) * 100), 0.0]
        result = classify_ground(points)
        scores[path.stem] = (
            100 * score_ground(result.classification, np.asarray(las.classification)).total_error
        )
    assert scores
    # Measured: 3.05 % in the mean, 8.49 % on samp11.
    assert np.mean(list(scores.values())) <= ISPRS_MEAN, scores
    assert max(scores.values()) <= ISPRS_WORST, scores
