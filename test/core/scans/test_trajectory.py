"""Poses between poses, and frames in frames."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lidar_buildings.core.scans.trajectory import Pose, Trajectory
from lidar_buildings.core.scans.transform_tree import MAX_FRAMES, TransformTree

SECOND = 1_000_000_000
T0 = 1_700_000_000 * SECOND
NO_TURN = (0.0, 0.0, 0.0, 1.0)


def turned(degrees, axis="z"):
    return tuple(Rotation.from_euler(axis, degrees, degrees=True).as_quat())


def times(*seconds):
    return T0 + np.rint(np.array(seconds) * SECOND).astype(np.int64)


def track(poses, max_gap=1.0, max_speed=100.0):
    trajectory = Trajectory(max_gap, max_speed)
    for second, pose in poses:
        trajectory.add(int(times(second)[0]), pose)
    return trajectory


def test_a_pose_lies_between_its_neighbours_in_place_and_attitude_by_the_shorter_way():
    found = track([(0.5, Pose((4.0, 2.0, 0.0), turned(90))), (0.0, Pose((0.0, 0.0, 0.0), NO_TURN))]).at(
        times(0.0, 0.125, 0.5)
    )
    assert found.is_known.all()
    np.testing.assert_allclose(found.translation, [[0, 0, 0], [1, 0.5, 0], [4, 2, 0]])
    np.testing.assert_allclose(found.rotation.as_euler("zyx", degrees=True)[:, 0], [0, 22.5, 90], atol=1e-9)
    back = tuple(-part for part in turned(10))
    found = track([(0.0, Pose((0, 0, 0), NO_TURN)), (0.5, Pose((0, 0, 0), back))]).at(times(0.25))
    np.testing.assert_allclose(found.rotation.as_euler("zyx", degrees=True)[0], [5, 0, 0], atol=1e-9)


def test_nothing_is_known_outside_in_gaps_and_where_the_pose_jumps():
    poses = [(0.0, (0, 0, 0)), (0.5, (1, 0, 0)), (2.5, (2, 0, 0)), (3.0, (102, 0, 0)), (3.5, (103, 0, 0))]
    trajectory = track([(second, Pose(place, NO_TURN)) for second, place in poses])
    found = trajectory.at(times(-0.1, 0.2, 0.5, 1.0, 2.5, 2.75, 3.0, 3.25, 3.6))
    assert found.is_known.tolist() == [False, True, True, False, True, False, True, True, False]


def test_one_pose_holds_at_its_own_time_alone_and_of_two_of_one_time_the_later():
    one = track([(1.0, Pose((5, 0, 0), NO_TURN))]).at(times(0.9, 1.0))
    assert one.is_known.tolist() == [False, True]
    assert not track([]).at(times(0.0)).is_known.any()
    trajectory = track([(0.0, Pose((0, 0, 0), NO_TURN)), (0.0, Pose((1, 0, 0), NO_TURN))])
    assert len(trajectory) == 1
    assert trajectory.at(times(0.0)).translation.tolist() == [[1, 0, 0]]


@pytest.mark.parametrize(
    ("place", "attitude"),
    [
        ((np.nan, 0, 0), NO_TURN),
        ((0, -np.inf, 0), NO_TURN),
        ((0, 0, 1e9), NO_TURN),
        ((0, 0, 0), (0.0, 0.0, 0.0, 0.0)),
        ((0, 0, 0), (1e-200, 0.0, 0.0, 0.0)),
        ((0, 0, 0), (0.0, np.nan, 0.0, 1.0)),
    ],
)
def test_a_pose_that_is_none_is_counted_and_left_out(place, attitude):
    made = tree()
    made.add("odom", "base", T0, Pose(place, attitude))
    made.add_static("base", "lidar", Pose(place, attitude))
    made.add_static("base", "radar", Pose(place, attitude))
    assert made.n_refused == 3
    assert "radar" not in made.frames
    np.testing.assert_allclose(made.poses("lidar", "map", times(0.0)).translation, [[100, 1, 2]], atol=1e-9)


def test_of_frames_without_end_the_first_are_taken():
    made = TransformTree(1.0, 100.0)
    for number in range(MAX_FRAMES + 10):
        made.add_static("base", f"frame{number}", Pose((0, 0, 0), NO_TURN))
    assert (len(made.frames), made.n_refused) == (MAX_FRAMES + 1, 10)


def test_poses_nanoseconds_apart_long_after_others_are_told_apart():
    trajectory = Trajectory(1.0, 1e12)
    for stamp, x in ((0, 0.0), (T0, 1.0), (T0 + 10, 2.0)):
        trajectory.add(stamp, Pose((x, 0, 0), turned(90 * x)))
    found = trajectory.at(np.array([T0 + 5]))
    np.testing.assert_allclose(found.translation, [[1.5, 0, 0]])
    np.testing.assert_allclose(abs(found.rotation.as_euler("zyx", degrees=True)[0, 0]), 135.0)


def test_poses_are_sorted_in_whenever_they_come(monkeypatch):
    monkeypatch.setattr("lidar_buildings.core.scans.trajectory._BATCH", 3)
    monkeypatch.setattr("lidar_buildings.core.scans.trajectory.MAX_POSES", 8)
    seconds = np.random.default_rng(0).permutation(20) / 10
    trajectory = track([(second, Pose((second, 0, 0), NO_TURN)) for second in seconds])
    assert len(trajectory) == 8
    np.testing.assert_allclose(trajectory.at(times(1.75, 1.9)).translation[:, 0], [1.75, 1.9])


def test_what_is_forgotten_leaves_the_poses_that_later_times_need():
    trajectory = track([(0.1 * i, Pose((i, 0, 0), NO_TURN)) for i in range(10)])
    trajectory.drop_before(int(times(0.45)[0]))
    assert len(trajectory) == 6
    found = trajectory.at(times(0.35, 0.45))
    assert found.is_known.tolist() == [False, True]
    np.testing.assert_allclose(found.translation[1], [4.5, 0, 0])


def tree():
    made = TransformTree(1.0, 100.0)
    made.add("map", "odom", T0, Pose((100, 0, 0), NO_TURN))
    made.add("map", "odom", T0 + SECOND // 2, Pose((100, 0, 0), NO_TURN))
    for i in range(2):
        made.add("odom", "/base", T0 + i * SECOND // 2, Pose((i, 0, 0), turned(90)))
    made.add_static("base", "lidar", Pose((1, 0, 2), NO_TURN))
    made.add_static("base", "camera", Pose((0, 0, 1), turned(180)))
    return made


def test_frames_are_chained_up_and_down():
    poses = tree().poses("lidar", "map", times(0.25))
    np.testing.assert_allclose(poses.apply(np.array([[1.0, 0.0, 0.0]])), [[100.5, 2, 2]], atol=1e-9)
    there = tree().poses("lidar", "camera", times(0.25))
    assert there.is_known.all()
    np.testing.assert_allclose(there.apply(np.array([[1.0, 0.0, 0.0]])), [[-2, 0, 1]], atol=1e-9)


def test_a_way_is_known_as_far_as_its_moving_parts_are():
    made = tree()
    assert made.known_until("lidar", "map") == T0 + SECOND // 2
    assert made.known_until("lidar", "camera") is None
    assert made.root_of("lidar") == "map"
    assert not made.has_way("lidar", "moon")
    with pytest.raises(KeyError, match="moon"):
        made.poses("lidar", "moon", times(0.0))


def test_what_is_fixed_is_not_changed_by_messages_and_loops_end():
    made = tree()
    made.set_fixed("base", "lidar", Pose((0, 0, 7), NO_TURN))
    made.add_static("base", "lidar", Pose((9, 9, 9), NO_TURN))
    made.add("odom", "lidar", T0, Pose((9, 9, 9), NO_TURN))
    assert made.poses("lidar", "base", times(0.0)).translation.tolist() == [[0, 0, 7]]
    made.add_static("lidar", "map", Pose((0, 0, 0), NO_TURN))
    assert made.root_of("camera") in {"map", "lidar", "odom", "base"}


@pytest.mark.parametrize("is_first", [True, False])
def test_of_two_parents_the_one_is_taken_that_leads_to_the_map(is_first):
    made = TransformTree(1.0, 100.0, "map")
    for number in range(20):
        stamp = T0 + number * SECOND // 10
        made.add("map", "odom", stamp, Pose((100, 0, 0), NO_TURN))
        for parent, x in (("odom", number), ("lost", 500.0))[:: 1 if is_first else -1]:
            made.add(parent, "base", stamp, Pose((x, 0, 0), NO_TURN))
    found = made.poses("base", "map", times(0.25, 1.25))
    assert found.is_known.all()
    np.testing.assert_allclose(found.translation[:, 0], [102.5, 112.5])
    assert made.doubts == [
        "frame 'base' has two parents, 'lost' and 'odom': poses in 'odom' are taken, which lead to 'map'; "
        "stop the other sender"
    ]


def test_of_two_parents_that_lead_nowhere_a_tree_that_knows_all_takes_the_better():
    whole = TransformTree(0.2, 100.0, "map")
    made = TransformTree(0.2, 100.0, "map", whole)
    for one in (whole, made):
        whole.settle()
        for number in range(40):
            stamp = T0 + number * SECOND // 10
            if number in (0, 1, 2, 20, 21, 22, 39):
                one.add("gappy", "base", stamp, Pose((500, 0, 0), NO_TURN))
            one.add("odom", "base", stamp, Pose((number, 0, 0), NO_TURN))
    assert whole.root_of("base") == "odom"
    assert made.poses("base", "odom", times(0.25, 2.25)).translation[:, 0].tolist() == [2.5, 22.5]
    assert len(made.doubts) == 1


def test_a_frame_that_changes_its_parent_is_followed():
    made = TransformTree(1.0, 100.0)
    for number in range(40):
        parent = "odom" if number < 20 else "other"
        made.add(parent, "base", T0 + number * SECOND // 10, Pose((number, 0, 0), NO_TURN))
    assert made.root_of("base") == "other"


@pytest.mark.parametrize("is_base_first", [True, False])
def test_what_is_fixed_in_two_frames_ties_them_together(is_base_first):
    made = TransformTree(1.0, 100.0)
    made.add("odom", "base", T0, Pose((10, 0, 0), NO_TURN))
    for parent, x in (("base", 1.0), ("sensor", 3.0))[:: 1 if is_base_first else -1]:
        made.add_static(parent, "imu", Pose((x, 0, 0), NO_TURN))
    made.add_static("sensor", "lidar", Pose((0, 0, 5), NO_TURN))
    np.testing.assert_allclose(made.poses("lidar", "odom", times(0.0)).translation, [[8, 0, 5]])
