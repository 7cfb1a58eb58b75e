"""Points placed by poses that are looked up now and then lie where each one's own pose puts it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lidar_buildings.core.scans.motion import place_points
from lidar_buildings.core.scans.trajectory import Pose, Trajectory

SECOND = 1_000_000_000
T0 = 1_700_000_000 * SECOND


def rolling(n_poses=201, gap=None, turn=1.0):
    """An aircraft that rolls, pitches and yaws by up to 100 degrees a second, 200 poses of it a second."""
    track = Trajectory(max_gap=0.5, max_speed=150.0)
    for k in range(n_poses):
        second = k / 200.0 + (gap if gap is not None and k > n_poses // 2 else 0.0)
        angles = 20.0 * turn * np.sin(np.array([5.0, 4.0, 3.0]) * second)
        x, y, z, w = Rotation.from_euler("xyz", angles, degrees=True).as_quat() * (-1) ** k
        track.add(T0 + round(second * SECOND), Pose((60.0 * second, 3.0 * second, 500.0), (x, y, z, w)))
    return track


@pytest.mark.parametrize("is_sorted", [True, False])
@pytest.mark.parametrize("n_points", [1, 7, 20_000])
def test_points_lie_where_their_own_poses_put_them(is_sorted, n_points):
    random = np.random.default_rng(0)
    track = rolling()
    times = T0 + random.integers(-SECOND // 20, SECOND + SECOND // 20, n_points)
    times = np.sort(times) if is_sorted else times
    points = random.uniform(-500.0, 500.0, (n_points, 3))
    placed, is_placed = place_points(track.at, track.stamps, times, points)
    poses = track.at(times)
    truth, is_known = poses.apply(points), poses.is_known
    np.testing.assert_array_equal(is_placed, is_known)
    np.testing.assert_allclose(placed[is_known], truth[is_known], atol=1e-4)


def test_nothing_is_placed_in_a_gap_but_at_the_poses_beside_it():
    track, random = rolling(gap=1.0), np.random.default_rng(0)
    before, after = track.stamps[100], track.stamps[101]
    assert after - before > SECOND
    times = np.concatenate([track.stamps[90:110], random.integers(before + 1, after, 5000)])
    _, is_known = place_points(track.at, track.stamps, times, np.zeros((len(times), 3)))
    assert is_known[:20].all()
    assert not is_known[20:].any()


def test_where_no_pose_is_known_no_point_is_placed():
    track, times = rolling(), np.arange(1000) + T0 + 100 * SECOND
    _, is_known = place_points(track.at, track.stamps, times, np.zeros((1000, 3)))
    assert not is_known.any()


def test_a_time_far_from_all_others_costs_no_look_ups_between():
    track = rolling()
    times = np.append(T0 + np.arange(1000) * 1000, np.int64(2**62))
    sizes = []

    def look_up(moments):
        sizes.append(len(moments))
        return track.at(moments)

    _, is_known = place_points(look_up, track.stamps, times, np.zeros((1001, 3)))
    assert max(sizes) <= 1001
    np.testing.assert_array_equal(is_known, times < T0 + SECOND)
