"""Rasters of ground and surface: values, alignment, what is known, and that tiles fit together."""

import numpy as np
import pytest

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.stages.terrain.config import RasterConfig
from lidar_buildings.core.stages.terrain.rasters import make_rasters
from lidar_buildings.core.stages.terrain.window import RasterWindow
from lidar_buildings.simulation.scene import Terrain, Wave

GROUND, TREE, ROOF = PointClass.GROUND, PointClass.HIGH_VEGETATION, PointClass.BUILDING
COARSE = RasterConfig(raster_resolution=1.0)
SLOPE = Terrain(10.0, (0.1, -0.05))
HILLS = Terrain(50.0, (0.05, 0.02), (Wave(3.0, 60.0), Wave(1.5, 35.0, 70.0)))


def scattered(size, density, seed=0):
    """Positions all over a rectangle from the origin."""
    random = np.random.default_rng(seed)
    return random.uniform(0.0, 1.0, (int(size[0] * size[1] * density), 2)) * size


def inside(xy, west, south, east, north):
    return (xy[:, 0] > west) & (xy[:, 0] < east) & (xy[:, 1] > south) & (xy[:, 1] < north)


def on(terrain, xy, height=0.0):
    return np.column_stack((xy, terrain.at(xy) + height))


def centres(rasters, origin=(0.0, 0.0)):
    return rasters.window.centres(*np.indices(rasters.window.shape), origin)


def truth(terrain, rasters):
    return terrain.at(centres(rasters).reshape(-1, 2)).reshape(rasters.window.shape)


def hall(xy, *sides, height=8.0, terrain=SLOPE):
    """Points and classes of ground with a flat-roofed hall on it."""
    roof = inside(xy, *sides)
    return on(terrain, xy, np.where(roof, height, 0.0)), np.where(roof, ROOF, GROUND)


@pytest.mark.parametrize("method", ["linear", "natural_neighbour"])
def test_the_dtm_of_a_plane_is_that_plane_under_a_hall_too(method):
    if method == "natural_neighbour":
        pytest.importorskip("startinpy")
    points, classes = hall(scattered((60, 50), 3.0), 20, 15, 45, 35)
    rasters = make_rasters(points, classes, RasterConfig(dtm_interpolation=method))
    error = rasters.dtm - truth(SLOPE, rasters)
    inner = np.s_[4:-4, 4:-4]
    assert np.abs(error[inner]).max() < 1e-4
    assert np.nanmax(np.abs(error)) < 0.15  # beyond the outermost points elevations go on level


def test_the_dsm_holds_the_roof_and_the_ndsm_its_height():
    points, classes = hall(scattered((60, 50), 12.0), 20, 15, 45, 35, terrain=Terrain(10.0))
    rasters = make_rasters(points, classes)
    roof = inside(centres(rasters).reshape(-1, 2), 21, 16, 44, 34).reshape(rasters.window.shape)
    off = ~inside(centres(rasters).reshape(-1, 2), 18, 13, 47, 37).reshape(rasters.window.shape)
    np.testing.assert_allclose(rasters.ndsm[roof], 8.0, atol=1e-5)
    np.testing.assert_allclose(rasters.dsm[roof], 18.0, atol=1e-5)
    np.testing.assert_allclose(rasters.ndsm[off & ~np.isnan(rasters.dtm)], 0.0, atol=1e-5)


def test_the_ground_is_the_mean_of_its_points_so_noise_grows_less():
    xy = scattered((40, 40), 40.0)
    points = on(Terrain(5.0), xy)
    points[:, 2] += np.random.default_rng(1).normal(0.0, 0.1, len(points))
    rasters = make_rasters(points, np.full(len(points), GROUND))
    # some ten points a cell of half a metre: a third of one point's noise, and less by interpolation
    assert np.nanstd(rasters.dtm) < 0.035
    assert abs(np.nanmean(rasters.dtm) - 5.0) < 0.003


@pytest.mark.parametrize("resolution", [0.3, 0.5, 1.0, 7.0])
@pytest.mark.parametrize("origin", [(0.0, 0.0), (85_000.0, 447_000.0), (-1234.5, -99.9)])
def test_cells_are_aligned_to_multiples_of_the_resolution_in_source_coordinates(resolution, origin):
    xy = scattered((30, 20), 2.0)
    rasters = make_rasters(
        on(SLOPE, xy), np.full(len(xy), GROUND), RasterConfig(raster_resolution=resolution), origin=origin
    )
    window = rasters.window
    west, north = window.corner
    low, high = xy.min(axis=0) + origin, xy.max(axis=0) + origin
    assert west <= low[0] < west + resolution
    assert north - resolution <= high[1] <= north
    assert west + window.width * resolution >= high[0] > west + (window.width - 1) * resolution
    middle = centres(rasters, origin)[window.height // 2, window.width // 2] + origin
    np.testing.assert_allclose((middle / resolution) % 1.0, 0.5, atol=1e-6)
    assert (np.diff(centres(rasters)[:, 0, 1]) < 0).all(), "the first row is the northernmost"


def test_ground_water_rail_and_road_carry_the_terrain_and_noise_counts_for_nothing():
    xy = scattered((30, 30), 4.0)
    points = on(Terrain(2.0), xy)
    classes = np.resize([GROUND, PointClass.WATER, PointClass.RAIL, PointClass.ROAD_SURFACE], len(xy))
    clean = make_rasters(points, classes, COARSE)
    errors = np.column_stack((scattered((30, 30), 0.1, 3), np.resize([-40.0, 90.0], 90)))
    noise = np.resize([PointClass.LOW_NOISE, PointClass.HIGH_NOISE], len(errors))
    rasters = make_rasters(np.vstack((points, errors)), np.append(classes, noise), COARSE)
    np.testing.assert_array_equal(rasters.dtm, clean.dtm)
    np.testing.assert_array_equal(rasters.dsm, clean.dsm)
    np.testing.assert_allclose(rasters.dtm, 2.0, atol=1e-4)


def test_later_returns_make_the_surface_only_where_no_first_return_is_near():
    xy = scattered((40, 20), 6.0)
    points = on(Terrain(0.0), xy)
    is_tree = xy[:, 0] < 20
    points[is_tree, 2] = 9.0
    below = points[is_tree & (np.arange(len(xy)) % 2 == 0)] * [1, 1, 0]
    everything = np.vstack((points, below))
    classes = np.where(everything[:, 2] > 1, TREE, GROUND)
    number = np.append(np.ones(len(points)), np.full(len(below), 2))
    firsts = make_rasters(everything, classes, return_number=number)
    # at the survey's edge no circle of first returns closes round a later one
    west = inside(centres(firsts).reshape(-1, 2), 2, 2, 18, 18).reshape(firsts.dsm.shape)
    assert np.nanmin(firsts.dsm[west]) == 9.0
    without_firsts = number > 1
    lasts = make_rasters(
        everything[without_firsts], classes[without_firsts], return_number=number[without_firsts]
    )
    np.testing.assert_allclose(lasts.dsm[~np.isnan(lasts.dsm)], 0.0, atol=1e-5)


def test_water_between_trees_lies_low_and_a_wet_roof_stays_a_roof():
    xy = scattered((80, 60), 10.0)
    canal, pond = inside(xy, 0, 20, 80, 32), inside(xy, 35, 45, 42, 52)
    trees = inside(xy, 0, 16, 80, 20) | inside(xy, 0, 32, 80, 36)
    trees &= np.random.default_rng(2).random(len(xy)) < 0.8  # some light falls through
    roof = inside(xy, 28, 40, 50, 58)
    points = on(Terrain(1.0), xy, np.where(trees, 12.0, np.where(roof, 7.0, 0.0)))
    classes = np.where(trees, TREE, np.where(roof, ROOF, GROUND))
    seen = ~canal & ~pond
    rasters = make_rasters(points[seen], classes[seen])
    at = centres(rasters).reshape(-1, 2)
    water = inside(at, 5, 22, 75, 30).reshape(rasters.window.shape)
    wet = inside(at, 36, 46, 41, 51).reshape(rasters.window.shape)
    np.testing.assert_allclose(rasters.dsm[water], rasters.dtm[water], atol=1e-6)
    np.testing.assert_allclose(rasters.dtm[water], 1.0, atol=1e-4)
    np.testing.assert_allclose(rasters.dsm[wet], 8.0, atol=1e-4)


def test_nothing_is_made_up_beyond_the_survey_nor_across_wide_water():
    xy = scattered((120, 100), 2.0)
    lake, bay = inside(xy, 40, 30, 90, 75), inside(xy, 0, 40, 12, 60)
    points = on(Terrain(0.0), xy[~lake & ~bay])
    rasters = make_rasters(points, np.full(len(points), GROUND), COARSE)
    at = centres(rasters).reshape(-1, 2)
    known = ~np.isnan(rasters.dtm)
    assert (known == ~np.isnan(rasters.dsm)).all()
    assert not known[inside(at, 58, 48, 72, 57).reshape(known.shape)].any(), "a lake 45 m wide has a middle"
    assert known[inside(at, 4, 42, 11, 58).reshape(known.shape)].all(), "a bay 20 m wide has not"
    wider = make_rasters(points, np.full(len(points), GROUND), RasterConfig(1.0, 30.0))
    assert not np.isnan(wider.dtm[5:-5, 5:-5]).any()
    nothing = make_rasters(points, np.full(len(points), GROUND), RasterConfig(1.0, 0.0))
    cells = {(int(x), int(y)) for x, y in np.floor(points[:, :2])}
    assert np.count_nonzero(~np.isnan(nothing.dsm)) == len(cells)


def town(density=5.0, size=(200.0, 160.0)):
    """Hills with halls, sheds and trees: points, classes and return numbers."""
    random = np.random.default_rng(4)
    xy = scattered(size, density)
    height, classes = np.zeros(len(xy)), np.full(len(xy), GROUND)
    for _ in range(40):
        x, y, w, h = random.uniform(0, size[0]), random.uniform(0, size[1]), *random.uniform(4, 22, 2)
        under = inside(xy, x, y, x + w, y + h)
        height[under], classes[under] = random.uniform(3, 12), random.choice([TREE, ROOF])
    return on(HILLS, xy, height), classes


def test_the_result_does_not_depend_on_the_order_of_the_points():
    points, classes = town(size=(80.0, 60.0))
    order = np.random.default_rng(5).permutation(len(points))
    one, other = make_rasters(points, classes), make_rasters(points[order], classes[order])
    assert one.window == other.window
    for name in ("dtm", "dsm", "distance"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


@pytest.mark.parametrize("tile_size", [50.0, 61.3])
def test_tiles_cover_every_cell_of_the_whole_and_agree_with_it(tile_size):
    points, classes = town()
    config = RasterConfig(0.5, 20.0)
    whole = make_rasters(points, classes, config, point_spacing=0.45)
    known = ~np.isnan(whole.dtm)
    dtm, dsm = (np.full(whole.window.shape, np.nan, dtype=np.float32) for _ in range(2))
    times = np.zeros(whole.window.shape, dtype=int)
    tile = np.floor(points[:, :2] / tile_size)
    for west, south in np.unique(tile, axis=0) * tile_size:
        near = inside(points, west - 50, south - 50, west + tile_size + 50, south + tile_size + 50)
        core = (tile * tile_size == (west, south)).all(axis=1)
        rasters = make_rasters(points[near], classes[near], config, is_core=core[near], point_spacing=0.45)
        here = whole.window.shared(rasters.window)
        assert rasters.window.shape == dtm[here].shape, "no tile knows more than the whole"
        mine = ~np.isnan(rasters.dtm)
        times[here] += mine
        dtm[here][mine], dsm[here][mine] = rasters.dtm[mine], rasters.dsm[mine]
    assert (known == (times > 0)).all()
    assert (times > 1).mean() < 0.02, "few cells lie as near to the core of one tile as of another"
    for mine, all_of_it in ((dtm, whole.dtm), (dsm, whole.dsm)):
        assert np.mean(np.abs(mine - all_of_it)[known] > 0.001) < 0.01


DEGENERATE = {
    "nothing": np.empty((0, 3)),
    "one point": np.array([[3.2, 4.7, 5.0]]),
    "two points": np.array([[3.2, 4.7, 5.0], [13.2, 9.7, 6.0]]),
    "one place": np.tile([3.2, 4.7, 5.0], (50, 1)),
    "one line": np.column_stack((np.arange(0, 40, 0.3), np.arange(0, 40, 0.3), np.full(134, 2.0))),
    "one line along x": np.column_stack((np.arange(0, 40, 0.3), np.zeros(134), np.full(134, 2.0))),
    "one height": np.column_stack((scattered((20, 20), 3.0), np.full(1200, 7.0))),
    "a grid": np.stack([*np.meshgrid(np.arange(15.0), np.arange(12.0)), np.ones((12, 15))], -1).reshape(
        -1, 3
    ),
    "far apart": np.array([[0.0, 0.0, 1.0], [3000.0, 0.0, 1.0]]),
}


@pytest.mark.parametrize("case", DEGENERATE)
@pytest.mark.parametrize("classes", ["ground", "roof", "noise", "first half ground"])
def test_degenerate_tiles_are_legal(case, classes):
    points = DEGENERATE[case]
    n = len(points)
    given = {
        "ground": np.full(n, GROUND),
        "roof": np.full(n, ROOF),
        "noise": np.full(n, PointClass.LOW_NOISE),
        "first half ground": np.where(np.arange(n) < (n + 1) // 2, GROUND, ROOF),
    }[classes]
    rasters = make_rasters(points, given, COARSE)
    assert rasters.dtm.shape == rasters.dsm.shape == rasters.distance.shape == rasters.window.shape
    assert rasters.dtm.dtype == rasters.dsm.dtype == np.float32
    if classes == "noise" or not n:
        assert rasters.window.shape == (0, 0)
        return
    cells = np.unique(np.floor(points[:, :2]), axis=0)
    assert np.count_nonzero(~np.isnan(rasters.dsm)) >= len(cells)
    known = ~np.isnan(rasters.dtm)
    assert known.any() == (classes != "roof"), "without ground there is no terrain"
    assert np.isfinite(rasters.ndsm[known]).all()
    if known.any():
        low, high = points[:, 2].min() - 1e-4, points[:, 2].max() + 1e-4
        assert ((rasters.dtm[known] >= low) & (rasters.dtm[known] <= high)).all()


def test_a_tile_of_neighbours_points_alone_has_no_cell():
    points, classes = town(size=(20.0, 20.0))
    rasters = make_rasters(points, classes, is_core=np.zeros(len(points), dtype=bool))
    assert rasters.window.shape == (0, 0)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"config": RasterConfig(raster_resolution=0.0)}, "raster_resolution = 0"),
        ({"classification": np.zeros(3)}, "classification has shape"),
        ({"return_number": np.zeros(3)}, "return_number has shape"),
        ({"is_core": np.ones(3, dtype=bool)}, "is_core has shape"),
        ({"points": np.full((4, 3), np.nan)}, "must be finite"),
        (
            {
                "points": np.array([[0, 0, 0], [50, 50, 0], [0, 0, 0], [1, 1, 0]]),
                "config": RasterConfig(raster_resolution=0.001),
            },
            "cells between these points",
        ),
    ],
)
def test_a_caller_s_mistake_is_named(given, words):
    arguments = {"points": np.zeros((4, 3)), "classification": np.full(4, 2)} | given
    with pytest.raises(ValueError, match=words):
        make_rasters(**arguments)


def test_points_far_from_a_tile_make_no_window_of_gigabytes():
    xy = scattered((60.0, 40.0), 2.0)
    xyz, classes = on(SLOPE, xy), np.full(len(xy), GROUND)
    far = np.vstack((xyz, [[10_000.0, 9_000.0, 0.0], [-9e7, 9e7, 0.0]]))
    alone, beside = make_rasters(xyz, classes), make_rasters(far, np.append(classes, [GROUND, TREE]))
    assert alone.window == beside.window
    np.testing.assert_array_equal(alone.dtm, beside.dtm)
    np.testing.assert_array_equal(alone.dsm, beside.dsm)


def test_windows_know_what_they_share():
    one, other = RasterWindow(0.5, 10, -20, 30, 40), RasterWindow(0.5, 35, -30, 30, 20)
    rows, columns = one.shared(other)
    assert (rows, columns) == (slice(0, 10), slice(25, 30))
    assert other.shared(one) == (slice(10, 20), slice(0, 5))
    assert one.part(columns, rows).corner == (17.5, 10.0)
    far = one.shared(RasterWindow(0.5, 1000, 1000, 5, 5))
    assert np.zeros(one.shape)[far].size == 0
