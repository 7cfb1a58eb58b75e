import math

import numpy as np
import pytest
import shapely

from bench.scenes.outlines import Scan
from lidar_buildings.core.neighbours.point_spacing import quantised_spacing
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern, as_pulses, measure_scan_patterns


def scanned(along, across, *, turn=0.0, jitter=0.1, size=12.0, seed=0):
    """Lines of pulses on a square roof; rows in the order of the scan, every second line backwards."""
    rng = np.random.default_rng(seed)
    reach = 0.75 * size
    u, v = np.arange(-reach, reach, along), np.arange(-reach, reach, across)
    lines = [np.column_stack((u[:: 1 - 2 * (k % 2)], np.full(len(u), one))) for k, one in enumerate(v)]
    flat = np.vstack(lines)
    flat += rng.normal(0, jitter * min(along, across), flat.shape)
    cos, sin = math.cos(turn), math.sin(turn)
    xy = flat @ np.array([[cos, sin], [-sin, cos]])
    inside = np.abs(xy).max(axis=1) <= size / 2
    return np.column_stack((xy, np.full(len(xy), 5.0)))[inside] + np.array([200.0, 300.0, 0.0])


def measure_scan_pattern(points, *, gps_time=None, point_source_id=None, point_spacing=None, **asked):
    """The pattern of points that are one group."""
    pulses = as_pulses(points, gps_time, point_source_id)
    group = np.zeros(len(points), dtype=np.int64)
    spacing = point_spacing or quantised_spacing(points)
    return measure_scan_patterns(pulses, group, 1, spacing, **asked)[0]


def off(direction, truth):
    """Angle between two directions that have no sense [deg]."""
    return abs(math.degrees((direction - truth + math.pi / 2) % math.pi - math.pi / 2))


@pytest.mark.parametrize("turn", [0.0, 0.4, 1.2, 2.9])
@pytest.mark.parametrize(("along", "across"), [(0.3, 0.6), (0.5, 1.5), (0.05, 0.5)])
def test_lines_are_found_in_bare_points(along, across, turn):
    size = 12.0 if along > 0.1 else 5.0
    found = measure_scan_pattern(scanned(along, across, turn=turn, size=size))
    assert off(found.direction, turn) < 2.0
    assert 0.0 <= found.direction < math.pi
    assert found.along == pytest.approx(along, rel=0.1)
    assert found.across == pytest.approx(across, rel=0.1)


@pytest.mark.parametrize("ratio", [1.1, 1.2, 1.35])
@pytest.mark.parametrize("jitter", [0.1, 0.3])
def test_lines_hardly_farther_apart_than_their_points_are_found_in_bare_points_if_asked(ratio, jitter):
    turn = 0.6
    plan = shapely.affinity.rotate(shapely.box(0, 0, 30, 18), 20.0)
    xy = Scan(math.degrees(turn), ratio, jitter).over(plan, 1.0, np.random.default_rng(3))
    points = np.column_stack((xy, np.zeros(len(xy))))
    assert measure_scan_pattern(points, point_spacing=1.0).is_isotropic
    found = measure_scan_pattern(points, point_spacing=1.0, min_ratio=1.0)
    assert off(found.direction, turn) < 4.0
    assert found.across / found.along == pytest.approx(ratio, rel=0.12)


def test_points_anywhere_in_their_cells_have_no_lines_whatever_is_asked():
    xy = Scan(30.0, 1.0, 0.5).over(shapely.box(0, 0, 30, 18), 1.0, np.random.default_rng(4))
    points = np.column_stack((xy, np.zeros(len(xy))))
    assert measure_scan_pattern(points, point_spacing=1.0, min_ratio=1.0).is_isotropic


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_time_tells_lines_that_are_denser_across_than_along(turn):
    points = scanned(1.0, 0.4, turn=turn, size=20.0)
    found = measure_scan_pattern(points, gps_time=1e5 + 1e-5 * np.arange(len(points)))
    assert off(found.direction, turn) < 2.0
    assert (found.along, found.across) == pytest.approx((1.0, 0.4), rel=0.12)
    bare = measure_scan_pattern(points)
    assert off(bare.direction, turn + math.pi / 2) < 2.0
    assert (bare.along, bare.across) == pytest.approx((0.4, 1.0), rel=0.12)


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_square_lattices_and_random_points_have_no_lines(turn):
    for jitter in (0.0, 0.05, 0.3):
        points = scanned(0.5, 0.5, turn=turn, jitter=jitter)
        assert measure_scan_pattern(points, point_spacing=0.5) == ScanPattern(0.0, 0.5, 0.5)
    rng = np.random.default_rng(1)
    for n_points in (25, 100, 3000):
        points = np.column_stack((rng.uniform(0, 10, (n_points, 2)), np.zeros(n_points)))
        assert measure_scan_pattern(points).is_isotropic
        assert measure_scan_pattern(points, gps_time=rng.uniform(0, 1, n_points)).is_isotropic


def test_zigzag_lines_have_the_mean_distance():
    v = np.repeat(np.arange(0, 30, 0.8), 40) + np.tile(np.linspace(0, 0.8, 40), 38)
    u = np.concatenate([np.linspace(0, 8, 40)[:: 1 - 2 * (k % 2)] for k in range(38)])
    points = np.column_stack((u, v, np.zeros(len(u))))
    found = measure_scan_pattern(points, gps_time=np.arange(len(u)))
    assert off(found.direction, 0.0) < 7.0
    assert found.along == pytest.approx(8 / 39, rel=0.1)
    assert found.across == pytest.approx(0.8, rel=0.15)


def test_an_overlap_has_the_spacing_of_one_strip():
    first = scanned(0.3, 0.9, turn=0.5)
    second = scanned(0.3, 0.9, turn=0.5, seed=4) + np.array([0.13, 0.37, 0.0])
    points = np.vstack((first, second))
    strip = np.repeat([7, 9], [len(first), len(second)])
    found = measure_scan_pattern(points, point_source_id=strip)
    assert off(found.direction, 0.5) < 2.0
    assert (found.along, found.across) == pytest.approx((0.3, 0.9), rel=0.1)


def test_strips_that_cross_have_no_direction():
    first, second = scanned(0.3, 0.9, turn=0.2), scanned(0.3, 0.9, turn=0.2 + math.pi / 2, seed=4)
    strip = np.repeat([1, 2], [len(first), len(second)])
    assert measure_scan_pattern(np.vstack((first, second)), point_source_id=strip).is_isotropic


def test_pulses_recorded_twice_are_no_lines():
    rng = np.random.default_rng(0)
    once = np.column_stack((rng.uniform(0, 15, (800, 2)), np.zeros(800)))
    for step in (0.0, 0.02, 0.08):
        twice = np.vstack((once, once + np.array([step, 0.0, -0.1])))
        assert measure_scan_pattern(twice).is_isotropic, step


def test_of_pulses_in_clumps_the_step_reaches_half_way_to_the_next_clump():
    x, y = np.meshgrid(np.arange(0.0, 20.0), np.arange(0.0, 10.0, 0.5))
    clumps = x.ravel()[:, None] + np.arange(5) * 0.08 + np.random.default_rng(0).uniform(0, 0.03, (x.size, 5))
    points = np.column_stack([clumps.ravel(), np.repeat(y.ravel(), 5), np.zeros(clumps.size)])
    found = measure_scan_pattern(points)
    assert found.along == pytest.approx(0.34, abs=0.03)
    assert off(found.direction, 0.0) < 2.0


def test_the_order_of_points_does_not_matter_and_the_pattern_turns_with_them():
    points = scanned(0.3, 0.7, turn=0.4)
    time = np.arange(len(points)) * 1e-5
    order = np.random.default_rng(3).permutation(len(points))
    for by_time in (None, time):
        found = measure_scan_pattern(points, gps_time=by_time)
        shuffled = None if by_time is None else by_time[order]
        assert measure_scan_pattern(points[order], gps_time=shuffled) == found
        mirrored = measure_scan_pattern(points * np.array([-1.0, 1.0, 1.0]), gps_time=by_time)
        assert off(mirrored.direction, -found.direction) < 1.0
        assert (mirrored.along, mirrored.across) == pytest.approx((found.along, found.across), rel=0.03)


@pytest.mark.parametrize("n_points", [0, 1, 2, 3, 50])
def test_degenerate_clouds_are_isotropic(n_points):
    column = np.arange(n_points)
    for points in (np.zeros((n_points, 3)), np.column_stack((column, column, column)).astype(float)):
        for time in (None, column):
            found = measure_scan_pattern(points, gps_time=time)
            assert found.is_isotropic
            assert found.along > 0.0


def test_wrong_arguments_are_named():
    with pytest.raises(ValueError, match="gps_time"):
        measure_scan_pattern(np.zeros((3, 3)), gps_time=np.zeros(2))
