"""The virtual scanner against exact truth."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import shapely

from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.simulation import SimulationConfig, make_scene, simulate_tile
from lidar_buildings.simulation.casting import ON_ROOF, cell_of, first_hit, surfaces_of
from lidar_buildings.simulation.scanner import joined, scan
from lidar_buildings.simulation.scene import Terrain, Tree, VirtualScene

#: Exact, but for the beams' width.
NOISELESS = SimulationConfig(
    range_noise=0.0, planimetric_noise=0.0, gross_error_share=0.0, beam_divergence_mrad=0.0
)


@pytest.fixture(scope="module")
def village():
    scene = make_scene("village", 0)
    return scene, list(scan(scene, 0))


@pytest.fixture(scope="module")
def village_points(village):
    return joined(village[1])


@pytest.mark.parametrize(("density", "direction"), [(0.3, 30.0), (2.0, 0.0), (8.0, 30.0)])
def test_the_mean_density_of_pulses_is_the_one_asked_for(density, direction):
    scene = make_scene("dense_block", 0)
    config = SimulationConfig(density=density, flight_direction_deg=direction, overlap=0.5, altitude=100.0)
    strips = list(scan(scene, 0, config))
    pulses = sum((strip.return_number == 1).sum() for strip in strips)
    assert len(strips) > 1
    assert pulses / np.prod(scene.size) == pytest.approx(density, rel=0.1)


def test_strips_cover_the_scene_without_gaps(village):
    scene, strips = village
    xy = np.concatenate([strip.points[:, :2] for strip in strips])
    cells = np.unique(np.floor(xy[(xy > 0).all(axis=1) & (xy < scene.size).all(axis=1)] / 5.0), axis=0)
    hidden = 0.01  # behind towers and halls
    assert len(cells) >= (1 - hidden) * np.prod(np.array(scene.size) / 5.0)


def test_roof_points_lie_on_their_planes_within_the_noise_and_roads_are_darker_than_grass(
    village, village_points
):
    scene, _ = village
    measured = village_points
    for building in scene.buildings:
        rows = (measured.true_building == building.number) & (measured.true_plane > 0)
        a, b, c = building.planes[measured.true_plane[rows] - 1].T
        x, y, z = measured.points[rows].T
        off = (z - (a * x + b * y + c)) / np.sqrt(a * a + b * b + 1)
        assert rows.sum() > 200
        # 3 cm along the beam and 3 cm along x and y are 3 cm across any plane; beams cross eaves askew.
        assert off.std() == pytest.approx(0.03, abs=0.005)
        assert np.abs(off).max() < 0.25
    axis = shapely.LineString([scene.roads[0].start, scene.roads[0].end])
    ground = village_points.true_class == PointClass.GROUND
    aside = shapely.distance(axis, shapely.points(village_points.points[ground, :2]))
    bright = village_points.intensity[ground]
    assert bright[aside < 2.5].mean() < 0.5 * bright[(aside > 5.0) & (aside < 15.0)].mean()


def test_without_noise_roof_points_lie_exactly_on_their_planes_inside_their_outlines():
    tile, truth = simulate_tile("roof_types", 2, NOISELESS, density=3.0)
    for building in truth.scene.buildings:
        rows = (truth.building == building.number) & (truth.plane > 0)
        a, b, c = building.planes[truth.plane[rows] - 1].T
        x, y, z = tile.points[rows].T
        assert np.abs(z - (a * x + b * y + c)).max() < 1e-4  # float32 near 200 m
        assert shapely.intersects_xy(building.polygon.buffer(1e-4), x, y).all()
    ground = truth.classification == PointClass.GROUND
    assert np.abs(tile.points[ground, 2] - 50.0).max() < 1e-4


def test_ground_points_lie_on_the_analytic_terrain_and_not_under_roofs(village, village_points):
    scene, _ = village
    measured = joined(list(scan(scene, 0, replace(NOISELESS, density=1.0))))
    ground = measured.points[measured.true_class == PointClass.GROUND]
    assert np.abs(ground[:, 2] - scene.terrain.at(ground[:, :2])).max() < 1e-3
    roofs = shapely.union_all([b.polygon for b in scene.buildings]).buffer(-0.4)
    ground = village_points.points[village_points.true_class == PointClass.GROUND]
    assert not shapely.intersects_xy(roofs, ground[:, 0], ground[:, 1]).any()


def test_vertical_beams_meet_the_same_roof_as_a_look_from_above():
    scene = make_scene("roof_types", 1)
    surfaces = surfaces_of(scene, 20.0)
    table = tuple(surfaces)
    for x, y in np.random.default_rng(0).uniform(0, 160, (500, 2)):
        cell = cell_of(x, y, surfaces.columns, surfaces.rows)
        z, kind, _ = first_hit((x, y, 1000.0, 0.0, 0.0), cell, 50.0, table)
        roofs = [b.roof_at(np.array([[x, y]]))[1][0] for b in scene.buildings]
        if np.isfinite(roofs).any():
            assert kind == ON_ROOF
            assert z == pytest.approx(np.nanmax(roofs))
        else:
            assert z == 50.0


def test_facade_points_lie_on_the_outline_between_ground_and_eave():
    tile, truth = simulate_tile("roof_types", 0, NOISELESS)
    facade = (truth.building > 0) & (truth.plane == 0)
    assert 100 < facade.sum() < 0.1 * (truth.building > 0).sum()
    assert (truth.classification[facade] == PointClass.BUILDING).all()
    for building in truth.scene.buildings[:4]:
        points = tile.points[facade & (truth.building == building.number)]
        distance = shapely.distance(building.polygon.exterior, shapely.points(points[:, :2]))
        assert np.all(distance < 1e-4)
        assert np.all(points[:, 2] <= building.roof_elevation_range[1])


def test_returns_of_a_pulse_are_numbered_from_the_highest_and_time_runs_on_between_strips(village):
    for strip in village[1]:
        first = np.flatnonzero(strip.return_number == 1)
        sizes = np.diff(np.append(first, len(strip.points)))
        assert np.array_equal(strip.number_of_returns, np.repeat(sizes, sizes))
        assert np.array_equal(strip.return_number, np.arange(len(strip.points)) - np.repeat(first, sizes) + 1)
        later = np.flatnonzero(strip.return_number > 1)
        assert (strip.points[later, 2] < strip.points[later - 1, 2]).all()
        assert np.array_equal(strip.gps_time[later], strip.gps_time[later - 1])
    times = [strip.gps_time for strip in village[1]]
    assert all((np.diff(time) >= 0).all() for time in times)
    assert all(before[-1] < after[0] for before, after in itertools.pairwise(times))
    assert [set(strip.point_source_id) for strip in village[1]] == [{1}, {2}]


def test_trees_give_several_returns_open_ground_one(village_points):
    vegetation = village_points.true_class == PointClass.HIGH_VEGETATION
    assert (village_points.number_of_returns[vegetation] > 1).mean() > 0.5
    assert village_points.number_of_returns.max() >= 4
    field, _ = simulate_tile("flat_terrain_empty", 0)
    assert (field.number_of_returns == 1).all()


def test_a_tree_over_a_roof_lets_some_pulses_through():
    house = make_scene("single_house", 0)
    x, y = house.buildings[0].polygon.centroid.coords[0]
    top = house.buildings[0].roof_elevation_range[1]
    scene = replace(house, trees=(Tree(x, y, top + 5.0, 3.0, 3.0),))
    measured = joined(list(scan(scene, 0)))
    under = (measured.true_plane > 0) & (np.hypot(*(measured.points[:, :2] - (x, y)).T) < 2.0)
    assert under.sum() > 5
    assert (measured.return_number[under] > 1).mean() > 0.8


def test_wide_beams_give_two_returns_at_eaves_and_narrow_ones_do_not():
    shares = []
    for divergence in (0.0, 1.0):
        tile, truth = simulate_tile("roof_types", 0, beam_divergence_mrad=divergence)
        shares.append((tile.number_of_returns[truth.building > 0] == 2).mean())
    assert shares[0] == 0.0
    assert shares[1] > 0.01


def test_scan_lines_go_to_and_fro_and_their_last_pulses_are_marked():
    # the scan lines of a strip between others end within the scene
    scene = VirtualScene("field", (40.0, 180.0), Terrain(10.0))
    strips = list(scan(scene, 0, SimulationConfig(altitude=100.0, gross_error_share=0.0)))
    strip = strips[len(strips) // 2]
    line = np.append(0, np.cumsum(strip.edge_of_flight_line)[:-1])
    assert line[-1] > 50
    assert set(strip.scan_direction) == {0, 1}
    for number in range(1, 20):
        rows = line == number
        (direction,) = set(strip.scan_direction[rows])
        step = np.diff(strip.scan_angle[rows])
        assert rows.sum() > 100
        assert (step > 0).all() if direction == 1 else (step < 0).all()
    at_end = strip.edge_of_flight_line == 1
    assert (np.abs(strip.scan_angle[at_end]) > 19.7).all()
    marked = np.diff(strip.gps_time[at_end])
    assert np.allclose(marked, marked[0])


def test_scan_angles_are_positive_to_the_right_of_the_flight():
    scene = VirtualScene("field", (100.0, 100.0), Terrain(10.0))
    (strip,) = scan(scene, 0, replace(NOISELESS, flight_direction_deg=90.0))
    right = strip.points[:, 0] - 50.0
    assert np.allclose(np.tan(np.deg2rad(strip.scan_angle)) * 300.0, right, atol=0.05)


def test_gross_errors_are_labelled_as_noise():
    tile, truth = simulate_tile("flat_terrain_empty", 0, gross_error_share=0.01)
    low, high = (truth.classification == code for code in (PointClass.LOW_NOISE, PointClass.HIGH_NOISE))
    assert (low.sum() + high.sum()) / len(tile) == pytest.approx(0.01, rel=0.2)
    assert (tile.points[low, 2] < 18.5).all()
    assert (tile.points[high, 2] > 59.0).all()


def test_a_scene_of_ones_own_and_an_empty_one_can_be_scanned():
    tile, truth = simulate_tile(VirtualScene("patch", (5.0, 5.0), Terrain(1.0)), density=0.05)
    assert len(tile) == len(truth.classification)
    assert truth.scene.buildings == ()
