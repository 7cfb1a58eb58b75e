"""What every method of roof selection must keep to, and what the published rules promise."""

from dataclasses import fields

import numpy as np
import pytest
import shapely

from bench.scenes import buildings as scenes
from bench.scenes.roofs import ROOF_SCENES
from lidar_buildings.core.model.parameters import spec_of
from lidar_buildings.core.neighbours import parallel
from lidar_buildings.core.stages.roof_selection.config import RoofSelectionConfig
from lidar_buildings.core.stages.roof_selection.selection import select_roofs

BUILDING = 6
METHODS = next(spec_of(field).choices for field in fields(RoofSelectionConfig) if field.name == "method")
METHODS = tuple(name for name in METHODS if name != "all")  # which tells nothing apart
#: Height and area of the Villalba study (Mancera-Taboada and others, 2012).
VILLALBA = {
    "method": "single_returns",
    "roof_returns": "single",
    "min_height": 0.65,
    "min_building_area": 40.0,
}

every_method = pytest.mark.parametrize("method", METHODS)


def classes(points, method, columns):
    """Return all classes that come of a method."""
    return select_roofs(points, RoofSelectionConfig(method=method), **columns).classification


def roofs(points, method="smooth_patches", columns=None, **settings):
    """Return which points a method takes for roof."""
    config = RoofSelectionConfig(method=method, **settings)
    found = select_roofs(points, config, **(columns or {}))
    return (found.classification == BUILDING) & ~found.is_facade


def of_rows(columns, rows):
    """Return some rows of all columns."""
    return {name: column[rows] for name, column in columns.items()}


def known(scene):
    """Return heights and classes of a scene of scenes.py on level ground."""
    height = scene.points[:, 2] - scenes.GROUND
    return {"height_above_ground": height, "classification": np.where(scene.is_ground, 2, 1)}


def f1(found, scene):
    """Return F1 of a roof scene."""
    judged = scene.is_judged
    hits = (found & scene.is_building & judged).sum()
    return 2 * hits / ((found & judged).sum() + (scene.is_building & judged).sum())


@pytest.fixture(scope="module")
def town():
    """Houses and trees at two points a square metre."""
    return ROOF_SCENES["trees_over_roofs"](density=4.0, rotation_deg=20.0)


@every_method
def test_the_order_of_points_does_not_matter(method, town):
    shuffle = np.random.default_rng(1).permutation(len(town.points))
    straight = classes(town.points, method, town.columns)
    assert (straight == BUILDING).any()
    shuffled = classes(town.points[shuffle], method, of_rows(town.columns, shuffle))
    np.testing.assert_array_equal(straight[shuffle], shuffled)


@every_method
def test_the_number_of_threads_does_not_matter(method, town, monkeypatch):
    expected = classes(town.points, method, town.columns)
    monkeypatch.setattr(parallel, "BLOCK", 128)
    monkeypatch.setattr(parallel, "n_cores", lambda: 4)
    np.testing.assert_array_equal(classes(town.points, method, town.columns), expected)


@every_method
def test_tiles_with_a_buffer_give_what_the_whole_gives(method, town):
    # The buffer holds every house that reaches into the tile.
    x, buffer, spacing = town.points[:, 0], 20.0, 0.5
    whole = select_roofs(
        town.points, RoofSelectionConfig(method=method), point_spacing=spacing, **town.columns
    ).classification
    for low, high in ((-np.inf, 24.7), (24.7, np.inf)):
        rows = np.flatnonzero((x >= low - buffer) & (x < high + buffer))
        core = (x[rows] >= low) & (x[rows] < high)
        tile = select_roofs(
            town.points[rows],
            RoofSelectionConfig(method=method),
            point_spacing=spacing,
            **of_rows(town.columns, rows),
        ).classification
        np.testing.assert_array_equal(tile[core], whole[rows][core])


@every_method
def test_a_tile_of_bare_ground_has_no_roof(method):
    x, y = np.meshgrid(np.arange(40.0), np.arange(40.0))
    points = np.column_stack([x.ravel(), y.ravel(), 0.02 * x.ravel()])
    assert not roofs(points, method).any()
    columns = {"height_above_ground": np.zeros(1600), "classification": np.full(1600, 2)}
    assert not roofs(points, method, columns).any()


@every_method
@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.ones((1, 3)),
        np.array([[0, 0, 5], [1, 0, 5.0]]),
        np.array([[0, 0, 5], [1, 0, 5], [0, 1, 5.0]]),
        np.full((60, 3), 7.0),
        np.arange(60.0)[:, None] * [0.5, 0.2, 0.0] + [0, 0, 6],
        np.array([[0, 0, 9], [1e7, 0, 9], [0, 1e7, 50.0]]),
    ],
    ids=["none", "one", "two", "three", "identical", "collinear", "far apart"],
)
def test_too_little_for_a_roof_is_none(method, points):
    n = len(points)
    columns = {"height_above_ground": np.full(n, 5.0), "classification": np.ones(n, dtype=int)}
    for given in ({}, columns):
        found = classes(points, method, given)
        assert (found.shape, found.dtype) == ((n,), np.uint8)
        assert not (found == BUILDING).any()


@every_method
@pytest.mark.parametrize("slope", [0.0, 0.7])
def test_a_plane_without_any_noise_is_roof(method, slope):
    x, y = np.meshgrid(np.arange(0, 12, 0.5), np.arange(0, 10, 0.5))
    points = np.column_stack([x.ravel(), y.ravel(), 5 + slope * x.ravel()])
    columns = {"height_above_ground": points[:, 2], "classification": np.ones(len(points), dtype=int)}
    assert roofs(points, method, columns).all()


@every_method
@pytest.mark.parametrize("name", ["points", "height_above_ground"])
def test_what_is_not_a_number_is_refused_by_name(method, name):
    scene = scenes.flat(density=2.0)
    columns, points = known(scene), scene.points.copy()
    target = points[:, 2] if name == "points" else columns[name]
    target[3] = np.nan
    with pytest.raises(ValueError, match=name):
        roofs(points, method, columns)


@every_method
@pytest.mark.parametrize("name", ["towers", "courtyards", "curved_roofs", "facades"])
def test_roofs_of_many_shapes_are_found_and_their_walls_are_not(method, name):
    scene = ROOF_SCENES[name](density=5.0)
    assert f1(roofs(scene.points, method, scene.columns), scene) > 0.93


def test_planar_cells_leave_out_trees_and_hold_on_to_roofs(town):
    found = roofs(town.points, "lasclassify", town.columns)
    assert f1(found, town) > 0.9
    assert found[town.is_building].mean() > 0.85


def test_a_higher_limit_of_planarity_accepts_rougher_roofs():
    x, y = np.random.default_rng(0).uniform(0, 16, (2, 2500))
    points = np.column_stack([x, y, 6 + np.random.default_rng(1).normal(0, 0.2, 2500)])
    columns = {"height_above_ground": points[:, 2], "classification": np.ones(2500, dtype=int)}
    assert roofs(points, "lasclassify", columns).mean() < 0.2
    assert roofs(points, "lasclassify", columns, max_planar_deviation=0.3).mean() > 0.95


def test_rugged_cells_alone_do_not_complete_a_roof():
    # A roof, and beside its edge scattered leaves, some of which lie on its plane by chance.
    random = np.random.default_rng(0)
    roof = np.column_stack([*random.uniform(0, 12, (2, 1500)), np.full(1500, 6.0)])
    leaves = random.uniform((12.6, 0, 3), (16, 12, 9), (1200, 3))
    points = np.vstack([roof, leaves])
    columns = {"height_above_ground": points[:, 2], "classification": np.ones(2700, dtype=int)}
    found = roofs(points, "lasclassify", columns, planarity_cell=4.0)
    assert found[:1500].mean() > 0.99
    tolerant = roofs(points, "lasclassify", columns, planarity_cell=4.0, min_rugged_deviation=10.0)
    assert found[1500:].sum() < tolerant[1500:].sum()


def test_sparse_clouds_get_larger_cells():
    scene = ROOF_SCENES["sparse_suburb"](density=0.6)
    # Two metres square hold 2.4 points of these.
    assert f1(roofs(scene.points, "lasclassify", scene.columns), scene) > 0.9


@pytest.mark.parametrize(("returns", "kept"), [("single", False), ("last", False), ("all", True)])
def test_split_pulses_at_eaves_are_roof_only_where_all_returns_count(returns, kept):
    scene = scenes.gable(density=8.0)
    rim = shapely.distance(scene.buildings[0].polygon.boundary, shapely.points(scene.points[:, :2]))
    edge = scene.is_roof & (rim < 0.3)
    columns = {**known(scene), "return_number": np.ones(len(edge), dtype=int), "number_of_returns": 1 + edge}
    found = roofs(scene.points, "single_returns", columns, roof_returns=returns)
    assert found[edge].all() == kept
    assert found[edge].any() == kept
    assert found[scene.is_roof & ~edge].mean() > 0.95


def test_last_returns_of_several_can_be_roof():
    scene = scenes.flat(density=8.0)
    columns = {**known(scene), "return_number": np.where(np.arange(len(scene.points)) == 0, 1, 2)}
    columns["number_of_returns"] = columns["return_number"]
    assert not roofs(scene.points, "single_returns", columns).any()
    found = roofs(scene.points, "single_returns", columns, roof_returns="last")
    assert found[scene.is_roof].all()


def test_the_settings_of_villalba_take_in_what_is_low_and_drop_what_is_small():
    scene = ROOF_SCENES["garages_sheds_awnings"]()
    box = {
        "house": ((6, 22), (8, 16)),
        "row of garages": ((8, 24), (36, 40)),
        "single garage": ((38, 42), (37, 39)),
    }
    x, y, _ = scene.points.T
    found = {
        name: roofs(scene.points, columns=scene.columns, **settings)
        for name, settings in (("villalba", VILLALBA), ("default", {"method": "single_returns"}))
    }
    inside = {
        name: scene.is_building & (x > a[0]) & (x < a[1]) & (y > b[0]) & (y < b[1])
        for name, (a, b) in box.items()
    }
    for name in ("house", "row of garages"):
        assert found["villalba"][inside[name]].mean() > 0.9
    # 19 m².
    assert not found["villalba"][inside["single garage"]].any()
    assert found["default"][inside["single garage"]].mean() > 0.9
