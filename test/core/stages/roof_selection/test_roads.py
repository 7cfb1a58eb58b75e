import numpy as np
import pytest

from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.selection import select_roofs

GRASS, ASPHALT = 0.45, 0.18
SIDE = 100.0


def meadow(reflectance=GRASS, spacing=0.7, seed=0):
    """Return even ground at 0 m as points, and its reflectance; 8 % noise as real sensors have."""
    random = np.random.default_rng(seed)
    x, y = (
        each.ravel() for each in np.meshgrid(np.arange(0.0, SIDE, spacing), np.arange(0.0, SIDE, spacing))
    )
    points = np.column_stack([x, y, np.zeros(len(x))]) + random.uniform(-0.2, 0.2, (len(x), 3)) * [1, 1, 0]
    return points, np.full(len(x), reflectance)


def with_roads(points, reflectance):
    """Lay a road of 8 m across, and return which points are on it."""
    on_road = abs(points[:, 0] - 0.5 * points[:, 1] - 20) < 4.5
    return on_road, np.where(on_road, ASPHALT, reflectance)


def measured(reflectance, gain=300.0, offset=0.0, noise=0.08, seed=3):
    random = np.random.default_rng(seed)
    return np.rint(offset + gain * reflectance * random.normal(1.0, noise, len(reflectance)))


def road_of(points, intensity, config=None, **columns):
    """Return which points become road; all are ground."""
    given = {
        "height_above_ground": np.zeros(len(points)),
        "classification": np.full(len(points), 2),
        "intensity": intensity,
        **columns,
    }
    classes = select_roofs(points, config, **given).classification
    assert set(np.unique(classes)) <= {2, 11}
    return classes == 11


def agreement(found, on_road):
    """Return the smaller of recall and precision."""
    return (found & on_road).sum() / max(found.sum(), on_road.sum())


def assert_found(found, on_road):
    # Cells of 1 m to 1.4 m go either way along the sides of a road of 8 m.
    assert agreement(found, on_road) > 0.85


@pytest.mark.parametrize(("gain", "offset"), [(300.0, 0.0), (100.0, 10.0), (50_000.0, 2000.0)])
@pytest.mark.parametrize("method", ["automatic", "thresholds"])
def test_a_dark_road_is_found_on_8_and_16_bit_sensors(method, gain, offset):
    points, reflectance = meadow()
    on_road, reflectance = with_roads(points, reflectance)
    # Some roofs' worth of darker and brighter things, as the percentiles of a real strip have them.
    reflectance[::40], reflectance[1::25] = 0.03, 0.6
    config = RoofSelectionConfig(road_method=method)
    assert_found(road_of(points, measured(reflectance, gain, offset), config), on_road)


def test_strips_with_gains_of_their_own_give_the_same_road():
    points, reflectance = meadow()
    on_road, reflectance = with_roads(points, reflectance)
    strip = (points[:, 1] > 50).astype(np.uint16) + 706
    intensity = np.where(strip == 706, measured(reflectance, 300.0), measured(reflectance, 1200.0, 150.0))
    assert_found(road_of(points, intensity, point_source_id=strip), on_road)
    # Taken for one strip, asphalt in the second is as bright as grass in the first.
    assert agreement(road_of(points, intensity), on_road) < 0.7


@pytest.mark.parametrize("reflectance", [GRASS, ASPHALT])
@pytest.mark.parametrize("seed", range(3))
def test_ground_of_one_kind_has_no_road(reflectance, seed):
    points, reflectance = meadow(reflectance, seed=seed)
    assert not road_of(points, measured(reflectance, seed=seed)).any()


@pytest.mark.parametrize("intensity", [np.zeros, np.ones])
@pytest.mark.parametrize("method", ["automatic", "thresholds", "none"])
def test_constant_intensity_gives_no_road(intensity, method):
    points, _ = meadow()
    assert not road_of(points, intensity(len(points)), RoofSelectionConfig(road_method=method)).any()


def test_only_ground_with_intensity_becomes_road_in_any_order_and_none_on_request():
    points, reflectance = meadow()
    _, reflectance = with_roads(points, reflectance)
    assert not road_of(points, None).any()
    assert not road_of(points, measured(reflectance), RoofSelectionConfig(road_method="none")).any()
    intensity = measured(reflectance)
    order = np.random.default_rng(5).permutation(len(points))
    np.testing.assert_array_equal(road_of(points[order], intensity[order]), road_of(points, intensity)[order])
    before = np.arange(len(points)) % 2 * 7 + 2
    classes = select_roofs(
        points,
        height_above_ground=np.zeros(len(points)),
        classification=before,
        intensity=measured(reflectance),
    ).classification
    assert (classes[before == 9] == 9).all()
    assert (classes == 11).any()


def test_small_dark_patches_and_narrow_dark_lines_are_no_road():
    points, reflectance = meadow(spacing=0.4)
    on_road, reflectance = with_roads(points, reflectance)
    x, y, _ = points.T
    patch = (abs(x - 85) < 3) & (abs(y - 15) < 3)
    line = abs(x - 0.5 * y - 45) < 0.6
    reflectance[(patch | line) & ~on_road] = ASPHALT
    found = road_of(points, measured(reflectance))
    assert_found(found, on_road)
    assert not found[patch].any()
    assert found[line].mean() < 0.05
    small = road_of(points, measured(reflectance), RoofSelectionConfig(min_road_area=10.0))
    assert small[patch].mean() > 0.8


def test_cars_and_marks_on_a_road_do_not_cut_it():
    points, reflectance = meadow(spacing=0.4)
    on_road, reflectance = with_roads(points, reflectance)
    along = points[:, 0] + 2 * points[:, 1]
    middle = abs(points[:, 0] - 0.5 * points[:, 1] - 20) < 0.15
    reflectance[middle & (along % 6 < 3)] = 0.8
    found = road_of(points, measured(reflectance))
    assert_found(found, on_road)
    assert found[middle].mean() > 0.9


def test_ground_under_leaves_is_dark_but_no_road():
    points, reflectance = meadow()
    on_road, reflectance = with_roads(points, reflectance)
    crown = np.hypot(points[:, 0] - 75, points[:, 1] - 25) < 9
    # Beneath the crown every pulse is split; where it came back as one it is weak.
    reflectance[crown] = ASPHALT
    crowns = points[crown] + [0.0, 0.0, 8.0]
    n = len(crowns)
    everything = np.vstack([points, crowns])
    found = road_of_all(everything, measured(np.append(reflectance, np.full(n, 0.2))), n)
    assert_found(found[: len(points)], on_road)
    assert found[: len(points)][crown & ~on_road].mean() < 0.05


def road_of_all(points, intensity, n_leaves):
    leaves = np.arange(len(points)) >= len(points) - n_leaves
    return (
        select_roofs(
            points,
            height_above_ground=np.where(leaves, 8.0, 0.0),
            classification=np.where(leaves, 1, 2),
            intensity=intensity,
            return_number=np.ones(len(points)),
            number_of_returns=np.where(leaves, 2, 1),
        ).classification
        == 11
    )


def test_a_limit_that_is_known_already_is_used():
    points, _ = meadow()
    normalised = np.full(len(points), 60.0)
    assert not road_of(points, None, normalised_intensity=normalised).any()
    assert road_of(points, None, normalised_intensity=normalised, dark_limit=90.0).all()
    assert not road_of(points, None, normalised_intensity=normalised, dark_limit=50.0).any()


def test_a_part_of_the_cloud_gives_the_same_road_with_a_known_limit():
    points, reflectance = meadow(spacing=0.5)
    _, reflectance = with_roads(points, reflectance)
    normalised = np.clip(measured(reflectance, 350.0), 0, 255)
    whole = road_of(points, None, normalised_intensity=normalised, dark_limit=100.0, point_spacing=0.5)
    core = (abs(points[:, 0] - 50) < 20) & (abs(points[:, 1] - 50) < 20)
    near = (abs(points[:, 0] - 50) < 40) & (abs(points[:, 1] - 50) < 40)
    part = road_of(
        points[near], None, normalised_intensity=normalised[near], dark_limit=100.0, point_spacing=0.5
    )
    assert (part[core[near]] == whole[core]).mean() > 0.995
