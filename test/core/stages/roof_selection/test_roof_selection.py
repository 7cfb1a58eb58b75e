import laspy
import numpy as np
import pytest
import shapely
from scipy.interpolate import LinearNDInterpolator

from bench.scenes import buildings as scenes
from lidar_buildings.core.model.classes import Rejection
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.selection import select_roofs
from lidar_buildings.evaluation.scores.cells import cells_of_points, cells_of_polygons, score_buildings

BUILDING = 6
WHOLE = ("flat", "shed", "gable", "hip", "l_shape", "touching_houses", "step_roof", "dormer", "courtyard",
         "round_tower", "house_on_slope", "duplicates")  # fmt: skip


def known(scene):
    """Return what the ground filter would hand on: heights and classes."""
    # The ground of every scene is a plane.
    base = np.column_stack([scene.points[:, :2], np.ones(len(scene.points))])
    plane = np.linalg.lstsq(base[scene.is_ground], scene.points[scene.is_ground, 2], rcond=None)[0]
    height = scene.points[:, 2] - base @ plane
    classes = np.where(scene.is_ground, 2, 1).astype(np.uint8)
    return {"height_above_ground": height, "classification": classes}


def recall_and_precision(found, truth):
    return (found & truth).sum() / truth.sum(), (found & truth).sum() / max(found.sum(), 1)


@pytest.mark.parametrize("density", [1.0, 8.0, 40.0])
@pytest.mark.parametrize("name", WHOLE)
def test_whole_roofs_are_found_with_one_set_of_parameters(name, density):
    scene = getattr(scenes, name)(density=density, rotation_deg=30)
    found = select_roofs(scene.points, **known(scene)).classification == BUILDING
    recall, precision = recall_and_precision(found, scene.is_roof)
    # At 1 pt/m² a roof has some 150 points, and a corner may lie beyond the last plane.
    assert recall > (0.96 if density == 1.0 else 0.97)
    assert precision > 0.99


@pytest.mark.parametrize("name", ["gable", "courtyard", "house_on_slope", "dormer"])
def test_points_alone_are_enough(name):
    scene = getattr(scenes, name)(density=8.0)
    classes = select_roofs(scene.points).classification
    recall, precision = recall_and_precision(classes == BUILDING, scene.is_roof)
    assert recall > 0.97
    assert precision > 0.97


@pytest.mark.parametrize(("slope_deg", "density"), [(60, 2), (60, 20), (75, 2), (75, 8), (78, 8), (78, 20)])
def test_a_spire_is_roof_and_the_walls_below_are_none(slope_deg, density):
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-30.0, 30.0, (2, int(3600 * density)))
    inwards = 5.0 - np.maximum(abs(x), abs(y))
    top = np.where(inwards > 0.0, 25.0 + inwards * np.tan(np.deg2rad(slope_deg)), 0.0)
    walls = np.column_stack([np.full(400, 5.05), rng.uniform(-5.0, 5.0, 400), rng.uniform(2.0, 24.0, 400)])
    points = np.vstack([np.column_stack([x, y, top]), walls])
    points[:, 2] += rng.normal(0.0, 0.03, len(points))
    is_ground = points[:, 2] < 1.0
    heights = {"height_above_ground": points[:, 2], "classification": np.where(is_ground, 2, 1)}
    found = select_roofs(points, **heights)
    is_tower = np.append(inwards > 0.0, np.zeros(len(walls), dtype=bool))
    assert (found.classification[is_tower] == BUILDING).mean() > 0.9
    assert not (found.classification[is_ground] == BUILDING).any()
    assert not ((found.classification == BUILDING) & ~found.is_facade)[len(x) :].any()


def sparse_roof(seen_below):
    """Return a level surface of 16 × 12 m in rows far apart above dense ground, and which points it has."""
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(0.0, 16.0, 0.9), np.arange(0.0, 12.0, 0.5))
    roof = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 6.0)])
    ground = np.column_stack([rng.uniform(-15.0, 30.0, (2, 24_000)).T, np.zeros(24_000)])
    is_below = ((ground[:, :2] > -0.3) & (ground[:, :2] < (16.2, 12.0))).all(axis=1)
    ground = ground[~is_below | seen_below]
    points = np.concatenate([roof, ground])
    points[:, 2] += rng.normal(0.0, 0.02, len(points))
    return points, np.arange(len(points)) < len(roof)


@pytest.mark.parametrize("seen_below", [False, True])
def test_a_roof_sparser_than_the_ground_is_one_unless_it_lets_ground_be_seen(seen_below):
    points, is_roof = sparse_roof(seen_below)
    known = {"height_above_ground": points[:, 2], "classification": np.where(is_roof, 1, 2)}
    found = select_roofs(points, **known, point_spacing=0.3).classification == BUILDING
    assert found[is_roof].mean() > 0.98 if not seen_below else found[is_roof].mean() < 0.5


def tree_scene(density=12.0):
    scene = scenes.tree_over_eave(density=density)
    is_tree = ~scene.is_ground & ~scene.is_roof
    number = np.ones(len(scene.points), dtype=np.uint8)
    of = np.ones(len(scene.points), dtype=np.uint8)
    # The crown's points are the first, second… of three returns.
    of[is_tree], number[is_tree] = 3, np.arange(is_tree.sum()) % 3 + 1
    return scene, is_tree, {"return_number": number, "number_of_returns": of}


def patch_of(rng, west, east, south, north, heights):
    """Points of one return each, some 0.35 m apart, at one height or between two."""
    x, y = np.meshgrid(np.arange(west, east, 0.35), np.arange(south, north, 0.35))
    places = np.column_stack([x.ravel(), y.ravel()])
    places += rng.uniform(-0.1, 0.1, places.shape)
    return np.column_stack([places, rng.uniform(*np.broadcast_to(heights, 2), len(places))])


def test_a_smooth_spot_of_a_crown_that_has_grown_onto_a_roof_is_no_part_of_it():
    rng = np.random.default_rng(0)
    tree = patch_of(rng, 9, 20, -1, 11, (9.5, 12.5))
    tree = tree[np.hypot(*(tree[:, :2] - (14.5, 5.0)).T) < 5.5]
    tree[abs(tree[:, :2] - (12.5, 5.0)).max(axis=1) < 1.6, 2] = 11.0
    roof = patch_of(rng, 0, 12, 0, 10, 6.0)
    points = np.vstack([roof, tree, patch_of(rng, -8, 28, -8, 18, 0.0)])
    found = select_roofs(points, height_above_ground=points[:, 2]).classification == BUILDING
    assert found[: len(roof)].mean() > 0.99
    assert not found[len(roof) :].any()


@pytest.mark.parametrize(("bulge", "share"), [(0.0, 1.0), (0.8, 0.0)], ids=["annex", "crown"])
def test_what_is_narrow_beside_a_house_is_roof_if_it_is_flat(bulge, share):
    rng = np.random.default_rng(0)
    house = patch_of(rng, 0, 18, 0, 16, (8.99, 9.01))
    beside = patch_of(rng, 18.5, 21.5, 3, 13, (4.98, 5.02))
    beside[:, 2] += bulge * np.cos(0.3 * (beside[:, 1] - 8.0))
    points = np.vstack([house, beside, patch_of(rng, -8, 30, -8, 26, 0.0)]) * (0.6, 0.6, 1.0)
    found = select_roofs(points, height_above_ground=points[:, 2]).classification == BUILDING
    assert found[: len(house)].mean() > 0.99
    assert found[len(house) : len(house) + len(beside)].mean() == pytest.approx(share, abs=0.05)


@pytest.mark.parametrize(
    ("size", "noise", "seen", "is_kept"),
    [
        ((2.6, 3.2), 0.02, 0.0, True),
        ((2.9, 5.0), 0.02, 0.0, True),
        ((2.0, 5.2), 0.02, 0.0, False),
        ((2.9, 3.2), 0.11, 0.0, False),
        ((3.0, 3.0), 0.02, 0.25, False),
        ((1.8, 1.8), 0.02, 0.0, False),
    ],
    ids=["shed", "garage", "van", "bush", "parasol", "box"],
)
def test_small_buildings_are_compact_even_and_closed(size, noise, seen, is_kept):
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(0.0, 20.0, (6400, 2)), rng.normal(0.0, 0.02, 6400)])
    is_object = (np.abs(points[:, :2] - 10.0) < np.array(size) / 2).all(axis=1) & (rng.random(6400) >= seen)
    points[is_object, 2] = 2.5 + rng.normal(0.0, noise, is_object.sum())
    found = select_roofs(points, height_above_ground=points[:, 2]).classification == BUILDING
    assert found[is_object].mean() == pytest.approx(float(is_kept), abs=0.02)
    assert not found[~is_object].any()


def test_a_large_part_of_a_roof_may_have_trees_all_along_its_free_rim():
    rng = np.random.default_rng(0)
    transept, nave = patch_of(rng, 20, 28, 0, 12, 10.0), patch_of(rng, 0, 20, -4, 16, 6.0)
    trees = patch_of(rng, 20, 34, -6, 18, (8.2, 11.8))
    is_beside = (trees[:, 0] > 28) | (abs(trees[:, 1] - 6.0) > 6.0)
    points = np.vstack([transept, nave, trees[is_beside], patch_of(rng, -8, 42, -12, 24, 0.0)])
    found = select_roofs(points, height_above_ground=points[:, 2]).classification == BUILDING
    assert found[: len(transept)].mean() > 0.95


def test_a_tree_over_the_eave_is_vegetation_and_the_roof_stays():
    scene, is_tree, returns = tree_scene()
    crown = is_tree & (scene.points[:, 2] > scenes.GROUND + 7)
    for given in ({}, returns):
        classes = select_roofs(scene.points, **known(scene), **given).classification
        # A fourteenth of the roof lies within the crown; half of that is lost among the leaves.
        assert (classes[scene.is_roof] == BUILDING).mean() > 0.95
        assert (classes[crown] == BUILDING).mean() < 0.05


def test_eaves_hit_by_first_returns_stay_roof():
    scene = scenes.gable(density=8.0)
    number, of = np.ones(len(scene.points), dtype=int), np.ones(len(scene.points), dtype=int)
    (building,) = scene.buildings
    at_edge = shapely.distance(building.polygon.boundary, shapely.points(scene.points[:, :2])) < 0.3
    of[at_edge & scene.is_roof] = 2
    classes = select_roofs(
        scene.points, **known(scene), return_number=number, number_of_returns=of
    ).classification
    assert (classes[at_edge & scene.is_roof] == BUILDING).mean() > 0.95


def test_a_chimney_belongs_to_its_roof_and_a_wall_does_not():
    scene = scenes.gable(density=16.0)
    (building,) = scene.buildings
    top = scene.points[scene.is_roof][:, 2].max()
    random = np.random.default_rng(0)
    chimney = np.column_stack([random.uniform(-0.4, 0.4, (20, 2)) + scenes.CENTRE, np.full(20, top + 1.0)])
    a, b = building.exterior[:2]
    steps = np.linspace(0.05, 0.95, 60)[:, None]
    line = a + steps * (b - a)
    wall = np.vstack(
        [np.column_stack([line, np.full(60, scenes.GROUND + z)]) for z in np.arange(0.4, 3.4, 0.25)]
    )
    points = np.vstack([scene.points, chimney, wall])
    height = np.concatenate(
        [known(scene)["height_above_ground"], points[len(scene.points) :, 2] - scenes.GROUND]
    )
    found = select_roofs(points, height_above_ground=height)
    n = len(scene.points)
    assert (found.classification[n : n + 20] == BUILDING).all()
    assert not found.is_facade[: n + 20].any()
    # Down to its foot the wall is of the building, but no roof; some of it hangs between the roof's points.
    wall_rows = n + 20 + np.flatnonzero(height[n + 20 :] > 0.8)
    assert (found.classification[wall_rows] == BUILDING).mean() > 0.75
    assert found.is_facade[wall_rows].mean() > 0.75


def test_vegetation_is_classed_by_height():
    # Too few and too far apart for any surface.
    height = np.array([0.0, 0.005, 0.01, 0.19, 0.2, 2.9, 3.0, 149, 150, -0.4])
    points = np.column_stack([np.arange(10) * 50.0, np.zeros(10), height])
    found = select_roofs(points, height_above_ground=height, classification=np.ones(10))
    assert found.classification.tolist() == [1, 1, 3, 3, 4, 4, 5, 5, 1, 1]


def test_what_is_known_as_ground_or_noise_is_kept_even_amid_a_roof():
    scene = scenes.flat(density=8.0)
    given = known(scene)
    rows = np.flatnonzero(scene.is_roof)[::10]
    for kept in (2, 7, 9, 11, 18):
        given["classification"][rows] = kept
        before = given["classification"].copy()
        classes = select_roofs(scene.points, **given).classification
        assert (classes[rows] == kept).all()
        assert np.array_equal(given["classification"], before), "what is given is not written to"


@pytest.mark.parametrize(
    "name", ["height_above_ground", "classification", "return_number", "number_of_returns"]
)
def test_a_column_of_the_wrong_length_is_refused_by_name(name):
    columns = {"return_number": np.ones(4), "number_of_returns": np.ones(4), name: np.ones(3)}
    with pytest.raises(ValueError, match=name):
        select_roofs(np.zeros((4, 3)), **columns)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("height_above_ground", [1.0, np.inf, 2.0, 3.0]),
        ("point_spacing", 0.0),
        ("point_spacing", np.nan),
        ("point_spacing", -1.0),
        ("dark_limit", np.inf),
        ("classification", [1, 2, 300, 1]),
    ],
)
def test_a_value_that_means_nothing_is_refused_by_name(name, value):
    with pytest.raises(ValueError, match=name):
        select_roofs(np.zeros((4, 3)), **{name: value})


def provider_cloud(files):
    """Return points, heights over the provider's ground, classes, returns; and the provider's roofs."""
    clouds = [laspy.read(file) for file in sorted(files)]
    xyz = np.vstack([cloud.xyz for cloud in clouds])
    points = xyz - np.floor(xyz.min(axis=0) / 100) * 100
    classes, number, of = (
        np.concatenate([np.asarray(cloud[name]) for cloud in clouds])
        for name in ("classification", "return_number", "number_of_returns")
    )
    ground = points[classes == 2]
    ground = ground[np.unique(np.floor(ground[:, :2]), axis=0, return_index=True)[1]]  # one a m²
    raised = np.flatnonzero(~np.isin(classes, (2, 9)))
    height = np.zeros(len(points))
    below = LinearNDInterpolator(ground[:, :2], ground[:, 2])(points[raised, :2])
    height[raised] = np.nan_to_num(points[raised, 2] - below)
    columns = {
        "height_above_ground": height,
        "classification": np.where(np.isin(classes, (2, 9)), classes, 1),
        "return_number": number,
        "number_of_returns": of,
    }
    return points, columns, classes == BUILDING


# Measured 0.97 and 0.88; the providers count façades and low sheds as building, which are no roofs here.
@pytest.mark.real_data
@pytest.mark.parametrize(("folder", "least"), [("fusa", 0.96), ("lowdensity", 0.88), ("montpellier", 0.95)])
def test_roofs_agree_with_the_providers(data_folder, folder, least):
    points, columns, truth = provider_cloud((data_folder / folder).glob("*.laz"))
    recall, precision = recall_and_precision(
        select_roofs(points, **columns).classification == BUILDING, truth
    )
    assert 2 * recall * precision / (recall + precision) > least


def base_map(file, origin):
    """Return a layer's polygons in the frame of the points."""
    pyogrio = pytest.importorskip("pyogrio")
    polygons = shapely.from_wkb(pyogrio.raw.read(file)[2])
    return shapely.transform(polygons, lambda corners: corners - origin[:2])


# Measured 0.85; the provider's own class 6 reaches 0.84, height and last return alone 0.82.
@pytest.mark.real_data
@pytest.mark.slow
def test_roof_cells_agree_with_the_base_map(data_folder):
    folder = data_folder / "delft"
    points, columns, _ = provider_cloud(folder.glob("*.laz"))
    origin = np.array([84800.0, 447400.0])
    is_roof = select_roofs(points, **columns).classification == BUILDING
    score = score_buildings(
        cells_of_points(points, is_roof, 0.5),
        cells_of_polygons(base_map(folder / "blocks_nw.gpkg", origin), 0.5),
        area=base_map(folder / "aoi_nw.gpkg", origin),
    )
    assert score.iou > 0.83
    assert score.recall > 0.94
    assert score.precision > 0.85


@pytest.mark.parametrize(
    ("size", "rise", "noise", "reason"),
    [
        ((12.0, 10.0), 5.0, 0.02, Rejection.NONE),
        ((12.0, 10.0), 1.5, 0.02, Rejection.LOW),
        ((3.9, 3.9), 3.0, 0.02, Rejection.SMALL),
        ((3.2, 3.2), 3.0, 0.02, Rejection.NARROW_BUILDING),
        ((20.0, 2.0), 3.0, 0.02, Rejection.NARROW_PART),
        ((12.0, 10.0), 5.0, 0.2, Rejection.ROUGH),
        ((12.0, 10.0), 5.0, 1.5, Rejection.FOLIAGE),
    ],
)
def test_points_that_are_no_roof_say_why(size, rise, noise, reason):
    random = np.random.default_rng(0)
    points = np.column_stack([random.uniform(0, 40, (16_000, 2)), random.normal(0, 0.02, 16_000)])
    is_object = (np.abs(points[:, :2] - 20.0) < np.array(size) / 2).all(axis=1)
    points[is_object, 2] = rise + random.normal(0, noise, is_object.sum())
    classes = np.where(is_object, 1, 2)
    config = RoofSelectionConfig(min_building_area=40.0)
    found = select_roofs(points, config, height_above_ground=points[:, 2], classification=classes)
    assert np.bincount(found.rejection[is_object]).argmax() == reason
    assert not found.rejection[found.classification == BUILDING].any()
    assert not found.rejection[~is_object].any()
