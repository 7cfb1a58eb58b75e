import laspy
import numpy as np
import pytest
from support.lattice import lattice

from bench.scenes import buildings as scenes
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.stages.ground_filter.classification import classify_ground
from lidar_buildings.core.stages.ground_filter.config import GroundFilterConfig

GROUND, LOW, HIGH = PointClass.GROUND, PointClass.LOW_NOISE, PointClass.HIGH_NOISE
WITHOUT_GROUND = {"single_point", "collinear"}
METHODS = ("consensus", "progressive_tin", "bidirectional_slope", "morphological")


def hilly_town(seed=0):
    """
    300 m x 160 m of rolling terrain (slopes to 25 %) with 40 box houses, 4 pts/m²; points and which are roof.
    """
    random = np.random.default_rng(seed)
    points = lattice(300.0, 160.0, 0.5, seed=seed)
    x, y = points[:, 0], points[:, 1]
    points[:, 2] += 100 + 6 * np.sin(x / 40) + 4 * np.cos(y / 40)
    roof = np.zeros(len(points), dtype=bool)
    for _ in range(40):
        centre = random.uniform((10, 10), (290, 150))
        half = random.uniform(4, 12, 2)
        inside = (np.abs(points[:, :2] - centre) < half).all(axis=1) & ~roof
        points[inside, 2] = points[inside, 2].max(initial=0.0) + random.uniform(3, 9)
        roof |= inside
    return points, roof


@pytest.mark.parametrize("name", [n for n in scenes.GALLERY if n not in WITHOUT_GROUND | {"with_nan"}])
def test_ground_is_found_and_roofs_are_not_ground(name):
    scene = scenes.GALLERY[name](rotation_deg=20.0)
    ground = classify_ground(scene.points).classification == GROUND
    assert not ground[scene.is_roof].any()
    # Noise of 3 cm against a tolerance of 30 cm; a roof's overhang hides nothing in these scenes.
    assert ground[scene.is_ground].mean() > 0.99


@pytest.mark.parametrize("name", ["flat", "courtyard", "house_on_slope"])
def test_heights_are_those_above_the_true_ground(name):
    scene = scenes.GALLERY[name](noise=0.0)
    height = classify_ground(scene.points).height_above_ground
    slope = np.array([0.2, 0.15]) if name == "house_on_slope" else np.zeros(2)
    truth = scene.points[:, 2] - scenes.GROUND - (scene.points[:, :2] - scenes.CENTRE) @ slope
    edge = (
        np.minimum(scene.points - scene.points.min(0), scene.points.max(0) - scene.points)[:, :2] < 1
    ).any(1)
    # A facet may be 5 cm off, and the terrain under a house is spanned from wall to wall.
    np.testing.assert_allclose(height[~edge], truth[~edge], atol=0.1)
    # In the outermost cells (1 m) only the lowest point is known: off by at most the slope over one of them.
    np.testing.assert_allclose(height[edge], truth[edge], atol=0.05 + np.hypot(*slope))


def town_with_errors(seed=0):
    """The town of `hilly_town` with a hundred gross errors, single and in groups, most of them below it."""
    points, _ = hilly_town(seed)
    random = np.random.default_rng(seed + 1)
    places = random.uniform((5, 5), (295, 155), (30, 2)).repeat(random.integers(1, 7, 30), axis=0)
    places = places + random.uniform(-1, 1, places.shape)
    errors = np.column_stack((places, random.uniform(60, 85, len(places))))
    birds = np.column_stack((random.uniform((5, 5), (295, 155), (8, 2)), random.uniform(150, 190, 8)))
    return np.vstack((points, errors, birds))


@pytest.mark.parametrize("method", METHODS)
def test_shuffled_rows_get_the_same_result(method):
    points, config = town_with_errors(), GroundFilterConfig(method=method)
    points = points[np.random.default_rng(0).uniform(size=len(points)) < 0.4]
    if method == "bidirectional_slope":
        # Without times it looks for scan lines in the order of rows, which matters a little.
        points = np.random.default_rng(0).permutation(points)
    rows = np.random.default_rng(1).permutation(len(points))
    straight, shuffled = classify_ground(points, config), classify_ground(points[rows], config)
    np.testing.assert_array_equal(shuffled.classification, straight.classification[rows])
    np.testing.assert_array_equal(shuffled.height_above_ground, straight.height_above_ground[rows])


@pytest.mark.parametrize("method", METHODS)
def test_the_number_of_threads_does_not_matter(method, monkeypatch):
    points = town_with_errors()[::2]
    results = []
    for n_threads in (1, 4):
        monkeypatch.setattr("os.cpu_count", lambda n_threads=n_threads: n_threads)
        results.append(classify_ground(points, GroundFilterConfig(method=method)))
    one, four = results
    np.testing.assert_array_equal(one.classification, four.classification)
    np.testing.assert_array_equal(one.height_above_ground, four.height_above_ground)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("size", "start"), [(60.0, 0.0), (110.0, -37.0)])
def test_less_than_a_percent_depends_on_how_the_cloud_is_cut_into_tiles(size, start, method):
    points, buffer, config = town_with_errors(), 20.0, GroundFilterConfig(method=method)
    whole = classify_ground(points, config).classification
    pieces = np.zeros_like(whole)
    for west in np.arange(start, 300.0, size):
        for south in np.arange(start, 160.0, size):
            offset = points[:, :2] - (west, south)
            tile = ((offset >= -buffer) & (offset < size + buffer)).all(axis=1)
            core = ((offset >= 0.0) & (offset < size)).all(axis=1)
            pieces[core] = classify_ground(points[tile], config).classification[core[tile]]
    assert (pieces != whole).mean() < 0.01


@pytest.mark.parametrize("method", METHODS)
def test_both_sides_of_a_cliff_are_ground(method):
    points = lattice(120.0, 120.0, 0.7)
    points[points[:, 0] > 60, 2] += 8.0
    ground = classify_ground(points, GroundFilterConfig(method=method)).classification == GROUND
    assert ground.mean() > 0.99


def test_a_steep_hillside_is_ground():
    points = lattice(100.0, 100.0, 0.8)
    points[:, 2] += 0.7 * points[:, 0]
    assert (classify_ground(points).classification == GROUND).mean() > 0.99


@pytest.mark.parametrize("method", ["consensus", "bidirectional_slope"])
def test_a_courtyard_and_the_street_are_ground_where_a_block_is_closed(method):
    points = lattice(110.0, 110.0, 0.5)
    away = np.abs(points[:, :2] - 55.0).max(axis=1)
    block = (away > 14) & (away < 40)
    points[block, 2] += 12.0
    ground = classify_ground(points, GroundFilterConfig(method=method)).classification == GROUND
    np.testing.assert_array_equal(ground, ~block)


def errors_below(n_points=20_000, share=0.99, seed=0):
    """Points of which only a few are of the surface; all others lie anywhere below it."""
    points = np.random.default_rng(seed).uniform(0, 60, (n_points, 3))
    points[:, 2] = np.where(np.arange(n_points) < share * n_points, -points[:, 2], 0.0)
    return points


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        [[1.0, 2.0, 3.0]],
        [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
        np.ones((100, 3)),
        np.column_stack((np.arange(200.0), 3 * np.arange(200.0), np.full(200, 7.0))),
        np.column_stack((np.full((50, 2), 2.0), np.arange(50) / 50)),
        [[0.0, 0.0, 0.0], [1e7, -1e7, 5.0], [1e7, 1e7, 50.0]],
        [[1e-9 * k, 0.0, 0.0] for k in range(20)],
        errors_below(),
        lattice(40.0, 40.0, 0.7) + np.array([3e5, 5e6, 0.0]),
        np.repeat(lattice(20.0, 20.0, 1.0), 3, axis=0),
    ],
    ids=[
        "none",
        "one",
        "two",
        "identical",
        "collinear",
        "vertical",
        "huge",
        "tiny",
        "nearly_all_errors",
        "far_from_the_origin",
        "three_times_each",
    ],
)
def test_degenerate_clouds_get_a_valid_result(points, method):
    result = classify_ground(points, GroundFilterConfig(method=method))
    assert result.classification.shape == result.height_above_ground.shape == (len(points),)
    assert result.classification.dtype == np.uint8
    assert np.isin(result.classification, [1, 2, 7, 18]).all()
    assert np.isfinite(result.height_above_ground).all()


@pytest.mark.parametrize("method", METHODS)
def test_every_method_finds_the_ground_of_a_town_and_not_its_roofs(method):
    points, roof = hilly_town()
    rows = points[:, 0] < 150.0
    ground = classify_ground(points[rows], GroundFilterConfig(method=method)).classification == GROUND
    assert ground[~roof[rows]].mean() > 0.98
    assert ground[roof[rows]].mean() < 0.02


@pytest.mark.parametrize("method", METHODS)
def test_low_points_are_no_ground_to_any_method(method):
    points = lattice(60.0, 60.0, 0.5)
    clump = np.random.default_rng(0).uniform((30, 30, -9), (31, 31, -8), (30, 3))
    result = classify_ground(np.vstack((points, clump)), GroundFilterConfig(method=method))
    assert (result.classification[len(points) :] == LOW).all()
    assert (result.classification[: len(points)] == GROUND).mean() > 0.99
    np.testing.assert_allclose(result.height_above_ground[len(points) :], clump[:, 2], atol=0.2)


def test_where_there_is_nothing_but_a_roof_it_is_the_ground():
    scene = scenes.flat(noise=0.0)
    result = classify_ground(scene.points[scene.is_roof])
    assert (result.classification == GROUND).all()
    assert (result.height_above_ground == 0.0).all()


def test_wrong_points_are_refused_by_name():
    with pytest.raises(ValueError, match="points"):
        classify_ground(np.zeros((5, 2)))
    with pytest.raises(ValueError, match="finite"):
        classify_ground(scenes.with_nan().points)
    with pytest.raises(ValueError, match="gps_time"):
        classify_ground(np.zeros((5, 3)), gps_time=np.zeros(4))


@pytest.mark.parametrize("given", [0.0, -2.0, np.nan])
def test_a_spacing_that_is_no_length_is_refused(given):
    with pytest.raises(ValueError, match="point_spacing"):
        classify_ground(np.zeros((5, 3)), point_spacing=given)


def test_a_window_with_the_spacing_of_its_survey_is_judged_as_the_survey_is():
    # Half of the pulses are missing in the west: what is measured there is another spacing.
    rng = np.random.default_rng(0)
    points = rng.uniform((0.0, 0.0, 0.0), (600.0, 200.0, 0.1), (40_000, 3))
    points[:, 2] += 0.15 * points[:, 1] + 6.0 * ((points[:, :2] % 40.0) < 12.0).all(axis=1)
    points = points[(points[:, 0] > 300.0) | (rng.random(len(points)) < 0.5)]
    points[:, :2] *= 3.0
    whole = classify_ground(points, point_spacing=6.0).classification
    window = points[:, 0] < 900.0
    inner = points[window, 0] < 600.0
    given, measured = (
        (classify_ground(points[window], point_spacing=one).classification != whole[window])[inner].mean()
        for one in (6.0, None)
    )
    assert given < 0.1 * measured


def test_a_bad_parameter_is_named_by_its_path():
    with pytest.raises(ParameterError, match=r"ground_filter\.iteration_angle"):
        GroundFilterConfig(iteration_angle=95.0)
    with pytest.raises(ParameterError, match=r"ground_filter\.method"):
        GroundFilterConfig(method="magic")


@pytest.mark.real_data
def test_building_blocks_of_a_real_town_are_not_ground(data_folder):
    cloud = laspy.read(data_folder / "delft" / "ahn3_cropped_1.laz")
    points = cloud.xyz - np.floor(cloud.xyz.min(axis=0))
    reference = np.asarray(cloud.classification)
    ground = classify_ground(points).classification == GROUND
    # Measured: 0.5 % (sheds and awnings that the provider calls building) and 0.06 %.
    assert ground[reference == PointClass.BUILDING].mean() < 0.01
    assert ground[reference == GROUND].mean() > 0.995
