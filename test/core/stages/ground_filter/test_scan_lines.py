"""
Scan lines: found by each thing that a file may say of them, and not found where the order is none of a scan.
"""

import laspy
import numpy as np
import pytest

from lidar_buildings.core.stages.ground_filter.scan_profiles import cut_profiles, find_scan_lines

SPACING = 1.0


def zigzag(n_lines=40, n_points=60, seed=0):
    """Points of a swinging mirror, line after line to and fro along y; and which line each lies on."""
    random = np.random.default_rng(seed)
    y = np.tile(np.arange(n_points) * SPACING, (n_lines, 1))
    y[1::2] = y[1::2, ::-1]
    x = np.arange(n_lines)[:, None] * SPACING + np.linspace(0, 0.8, n_points)
    points = np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))
    points[:, :2] += random.normal(0, 0.05, (x.size, 2))
    return points, np.repeat(np.arange(n_lines), n_points)


def parallel(**options):
    """Points of a rotating mirror: every line in the same direction."""
    points, line = zigzag(**options)
    return points[np.lexsort((points[:, 1], line))], line


def agree(found, line):
    """Share of neighbouring points on which two numberings agree whether a line ends between them."""
    return np.mean((np.diff(found) != 0) == (np.diff(line) != 0))


@pytest.mark.parametrize("scan", [zigzag, parallel])
@pytest.mark.parametrize("turn_deg", [0.0, 33.0, 90.0])
def test_lines_are_found_from_the_way_that_points_take(scan, turn_deg):
    points, line = scan()
    c, s = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    points[:, :2] = points[:, :2] @ np.array([[c, s], [-s, c]])
    found = find_scan_lines(points, SPACING)
    # Of the two points at a turn either may be the last of its line: one point in sixty, counted twice.
    assert len(set(found.line)) == 40
    assert agree(found.line, line) > 0.96


def test_lines_follow_the_direction_flag():
    points, line = zigzag()
    found = find_scan_lines(points, SPACING, scan_direction_flag=(line % 2).astype(np.uint8))
    np.testing.assert_array_equal(found.line, line)


@pytest.mark.parametrize("flag", [0, 1])
def test_a_flag_that_never_changes_is_no_use_and_does_no_harm(flag):
    points, _ = zigzag()
    found = find_scan_lines(points, SPACING, scan_direction_flag=np.full(len(points), flag, dtype=np.uint8))
    np.testing.assert_array_equal(found.line, find_scan_lines(points, SPACING).line)


def test_lines_turn_where_the_scan_angle_turns():
    points, line = zigzag()
    # The turns lie half a line before the ends of the strip, so that only the angle can tell.
    angle = 20.0 * np.cos(np.pi * (np.arange(len(points)) - 30) / 60.0)
    found = find_scan_lines(points, SPACING, scan_angle=angle)
    assert agree(found.line, line) < 1.0
    turns = np.flatnonzero(np.diff(found.line) != 0)
    assert (np.abs((turns - 30 + 30) % 60 - 30) <= 1).all()


def test_times_bring_shuffled_points_back_into_lines():
    points, _ = zigzag()
    time = np.arange(len(points)) * 1e-5
    rows = np.random.default_rng(1).permutation(len(points))
    found = find_scan_lines(points[rows], SPACING, gps_time=time[rows])
    np.testing.assert_array_equal(found.line, find_scan_lines(points, SPACING).line[rows])


def test_strips_that_alternate_in_the_file_are_taken_apart():
    one, _ = zigzag(seed=1)
    other, _ = zigzag(seed=2)
    points = np.stack((one, other + np.array([0.5, 0.3, 0.0])), axis=1).reshape(-1, 3)
    strip = np.tile([7, 3], len(one))
    found = find_scan_lines(points, SPACING, point_source_id=strip)
    assert set(found.line[strip == 3]).isdisjoint(found.line[strip == 7])
    assert abs(len(set(found.line)) - 80) <= 1


def test_returns_of_a_pulse_that_jump_to_and_fro_do_not_break_lines():
    points, line = zigzag()
    random = np.random.default_rng(3)
    # An oblique pulse through a tree: its first return lies up to 4 m before the last.
    first = points[::3] + np.column_stack(
        (np.zeros((len(points[::3]), 1)), random.uniform(-4, 0, (len(points[::3]), 2)))
    )
    order = np.argsort(np.concatenate((np.arange(len(points)), np.arange(0, len(points), 3) - 0.5)))
    found = find_scan_lines(np.vstack((points, first))[order], SPACING)
    both = np.concatenate((line, line[::3]))[order]
    # A line may end some points early or late, but there are as many of them.
    assert abs(len(set(found.line)) - len(set(line))) <= 2
    assert agree(found.line, both) > 0.97


@pytest.mark.parametrize("cell", [3.0, 10.0, 30.0])
def test_points_sorted_into_cells_have_no_scan_lines(cell):
    points, _ = zigzag(n_lines=150, n_points=150)
    column, row = (points[:, :2] // cell).T
    rows = np.lexsort((np.random.default_rng(0).random(len(points)), column, row))
    assert find_scan_lines(points[rows], SPACING) is None


def test_shuffled_points_have_no_scan_lines():
    points, _ = zigzag()
    assert find_scan_lines(np.random.default_rng(0).permutation(points), SPACING) is None


def test_points_along_a_curve_that_fills_the_plane_have_no_scan_lines():
    points, _ = zigzag(n_lines=128, n_points=128)
    column, row = (points[:, :2] / 0.5).astype(np.int64).clip(0).T
    key = np.zeros(len(points), dtype=np.int64)
    for bit in range(9):
        key |= ((column >> bit) & 1) << (2 * bit) | ((row >> bit) & 1) << (2 * bit + 1)
    assert find_scan_lines(points[np.argsort(key)], SPACING) is None


def test_profiles_hold_every_point_once_and_rise_along_each():
    points, _ = zigzag()
    for profiles in (
        cut_profiles(points, 1.5, 45.0),
        find_scan_lines(points, SPACING).profiles(points, np.arange(len(points))),
    ):
        np.testing.assert_array_equal(np.sort(profiles.rows), np.arange(len(points)))
        assert profiles.first[0] == 0
        assert profiles.first[-1] == len(points)
        for begin, end in zip(profiles.first[:-1], profiles.first[1:], strict=True):
            assert (np.diff(profiles.along[begin:end]) >= 0).all()


@pytest.mark.real_data
def test_real_files_in_the_order_of_their_scan_are_known_as_such(data_folder):
    for path in sorted((data_folder / "isprs").glob("*.laz")):
        points = laspy.read(path).xyz
        points = points - np.floor(points.min(axis=0))
        spacing = np.sqrt(np.prod(np.ptp(points[:, :2], axis=0)) / len(points))
        found = find_scan_lines(points, spacing)
        assert found is not None, path.name
        # Lines run north-south in these: tens of points in each, spread along y alone.
        assert len(points) / len(set(found.line)) > 20
        assert find_scan_lines(np.random.default_rng(0).permutation(points), spacing) is None
