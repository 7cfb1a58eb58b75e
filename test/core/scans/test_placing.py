"""Whatever comes of a scanner and of poses, points are placed right, or left out and counted."""

import numpy as np
import pytest
from support.scan_messages import SECOND, T0, cloud_of, odometry, scan, transforms

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.scans import placing
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.point_times import N_SCANS
from lidar_buildings.core.scans.scan import NO_RETURN, NO_TIME, NOT_FINITE

POINTS = np.array([[5.0, 1.0, 0.0], [5.0, 2.0, 0.0], [5.0, 3.0, 0.0]])
#: The sensor drives along x.
SPEED = 10.0


class Drive:
    """Sends poses and scans of a sensor that moves along x; the clock may be set."""

    def __init__(self, **config):
        self.placer = placing.ScanPlacer(ScanConfig(**config))
        self.found = []

    def pose(self, second, x=None, clock=0.0):
        self.placer.add_odometry(odometry(stamp(second + clock), (SPEED * second if x is None else x, 0, 0)))

    def poses(self, begin, end, **more):
        for second in np.arange(begin, end, 0.05):
            self.pose(second, **more)

    def scan(self, second, clock=0.0, **more):
        self.placer.add_scan(scan(stamp(second + clock), POINTS + np.array([0, 0, 100 * second]), **more))
        self.take()

    def take(self, **how):
        for one in self.placer.placed(**how):
            self.found.extend(one.points)

    def end(self):
        """Return the second of each placed point, by its height; all lie where they were measured."""
        self.take(is_end=True)
        points = np.array(self.found).reshape(-1, 3)
        seconds = np.rint(points[:, 2]) / 100
        since = (points[:, 1] - 1) / 2 * 0.1
        np.testing.assert_allclose(points[:, 0], 5 + SPEED * (seconds + since), atol=1e-5)
        return seconds.tolist()


def stamp(second):
    return T0 + round(second * SECOND)


def test_scans_and_poses_come_in_any_order_and_points_in_that_of_the_scans():
    drive = Drive()
    drive.scan(0.2)
    drive.scan(0.0)  # out of order
    for second in (0.5, 0.0, 0.25, 0.1, 0.3):
        drive.pose(second)
    assert drive.end() == [0.2] * 3 + [0.0] * 3
    assert not drive.placer.left_out
    assert not drive.placer.messages


def test_a_scan_that_comes_twice_counts_once():
    drive = Drive()
    for _ in range(3):
        drive.scan(0.1)
    drive.scan(0.1, frame="other")
    drive.poses(0.0, 0.5)
    assert drive.end() == [0.1] * 3
    assert drive.placer.messages == {placing.TWICE: 2}
    assert drive.placer.left_out == {placing.NO_WAY: 3}


@pytest.mark.parametrize("is_scan_first", [True, False])
@pytest.mark.parametrize("by", [2.0, 5.0, 100.0])
def test_after_the_clock_was_set_back_poses_of_before_place_nothing(by, is_scan_first):
    drive = Drive()
    drive.poses(0.0, 6.0)
    drive.scan(5.5)
    drive.scan(5.94)  # waits for poses that never come
    if is_scan_first:
        drive.scan(6.1, clock=-by)
    drive.poses(6.0, 9.0, clock=-by)
    if not is_scan_first:
        drive.scan(6.1, clock=-by)
    drive.scan(7.0, clock=-by)
    assert sorted(set(drive.end())) == [5.5, 5.94, 6.1, 7.0]
    assert drive.placer.messages == {placing.CLOCK_SET_BACK: 1}
    assert drive.placer.left_out == {placing.NO_POSE: 2}


def test_of_two_sources_with_clocks_of_their_own_one_is_left_out_until_the_other_ends():
    drive = Drive()
    refused = []
    for second in np.arange(0.0, 20.0, 0.05):
        for clock in (0.0, -300.0):
            drive.pose(second, clock=clock)
        for clock in (0.0, -300.0) if round(second * 20) % 4 == 1 else ():
            try:
                drive.scan(second, clock=clock)
            except MessageError as error:
                refused.append(str(error))
    drive.poses(20.0, 80.0, clock=-300.0)
    drive.scan(79.0, clock=-300.0)
    seconds = drive.end()
    assert min(seconds) < 1.0
    assert seconds[-1] == 79.0
    assert len(seconds) > 3 * 98
    assert len(refused) > 95
    assert set(refused) == {placing.TWO_CLOCKS}
    assert drive.placer.messages[placing.CLOCK_SET_BACK] <= 4
    assert drive.placer.messages[placing.TWO_CLOCKS] > 400 + len(refused) - 10


def test_one_stamp_from_the_future_costs_half_a_second_of_poses_at_most():
    drive = Drive()
    drive.poses(0.0, 2.0)
    drive.pose(3600.0, x=20.0)
    drive.poses(2.0, 4.0)
    drive.scan(1.0)
    drive.scan(3.0)
    assert drive.end() == [1.0] * 3 + [3.0] * 3


def test_a_large_scan_is_placed_in_parts_as_it_would_be_at_once(monkeypatch):
    found = []
    for batch in (1_000_000, 7):
        monkeypatch.setattr("lidar_buildings.core.scans.placing._BATCH", batch)
        drive = Drive()
        drive.poses(0.0, 0.6)
        drive.placer.add_scan(scan(T0, np.ones((50, 3)), seconds=np.linspace(0.9, 0.0, 50)))
        found += drive.placer.placed(is_end=True)
    assert 10 < len(found[0].points) < 50
    np.testing.assert_array_equal(found[0].points, found[1].points)


def test_points_in_a_gap_and_where_a_pose_jumps_are_left_out_and_counted():
    drive = Drive()
    drive.poses(0.0, 1.01)
    drive.poses(2.0, 3.01)
    drive.pose(3.2, x=132.0)  # a jump of 100 m
    drive.poses(3.4, 5.0)
    for second in (0.5, 1.5, 2.5, 3.08, 3.25, 4.0):
        drive.scan(second)
    assert drive.end() == [0.5] * 3 + [2.5] * 3 + [4.0] * 3
    assert drive.placer.left_out == {placing.NO_POSE: 9}
    assert drive.placer.messages == {placing.TOO_FAST.format(510.0): 2}


def test_poses_that_are_none_are_told():
    drive = Drive()
    drive.poses(0.0, 1.0)
    drive.pose(0.52, x=np.nan)
    drive.placer.add_odometry(odometry(stamp(0.53), (0, 0, 0), (0, 0, 0, 0)))
    drive.scan(0.5)
    assert drive.end() == [0.5] * 3
    assert drive.placer.messages == {placing.NO_POSES: 2}


def test_what_is_no_measurement_is_left_out_and_counted():
    placer = placing.ScanPlacer(ScanConfig(georeferenced=True))
    points = [[1, 2, 3], [0, 0, 0], [np.nan, 0, 0], [np.inf, 0, 0], [1e30, 0, 0], [4, 5, 6], [7, 8, 9]]
    seconds = [0, 0, 0, 0, 0, np.nan, 0.1]
    values = {"intensity": [-1, 1, 1, 1, 1, 1, np.nan], "gps_time": [np.inf] * 7, "scan_angle": [np.nan] * 7}
    placer.add_scan(scan(T0, points, seconds=seconds, **values))
    (found,) = placer.placed(is_end=True)
    np.testing.assert_allclose(found.points, [[1, 2, 3], [7, 8, 9]])
    assert (found.times - T0).tolist() == [0, pytest.approx(SECOND // 10, abs=10)]
    assert {name: column.tolist() for name, column in found.columns.items()} == {
        "intensity": [0, 0],
        "scan_angle": [0, 0],
    }
    assert placer.left_out == {NOT_FINITE: 3, NO_RETURN: 1, NO_TIME: 1}


def test_a_layout_may_change_be_big_endian_or_empty_in_mid_stream():
    placer = placing.ScanPlacer(ScanConfig(georeferenced=True))
    packed = np.zeros(3, [("z", "<f8"), ("pad", "u1"), ("y", "<f4"), ("x", "<f4"), ("t", "<u4")])
    packed["x"], packed["y"], packed["z"] = POINTS.T
    found = []
    for message in (
        scan(T0, POINTS),
        scan(T0 + 1, POINTS, kind=">f8", intensity=[1, 2, 3]),
        scan(T0 + 2, np.zeros((0, 3))),
        cloud_of(T0 + 3, "lidar", packed),
    ):
        placer.add_scan(message)
        found += placer.placed(is_end=True)
    assert [len(one.points) for one in found] == [3, 3, 0, 3]
    for one in (found[0], found[1], found[3]):
        np.testing.assert_allclose(one.points, POINTS)
    assert found[1].columns["intensity"].tolist() == [1, 2, 3]


def test_scans_that_are_alike_are_placed_as_one_in_the_order_in_which_they_came():
    names = ["lidar", "lidar", "second", "lidar", "lidar", "second"]
    one_by_one, at_once = placing.ScanPlacer(), placing.ScanPlacer()
    expected = []
    for placer in (one_by_one, at_once):
        for k in range(10):
            stamp = T0 + k * SECOND // 10
            for child in set(names):
                placer.add_transforms(transforms((stamp, "map", child, (k, 0.0, 0.0))), is_static=False)
    for k, name in enumerate(names):
        more = {"intensity": [k, k, k]} if k != 3 else {}
        message = scan(T0 + k * SECOND // 10, POINTS + 0.1 * k, frame=name, **more)
        one_by_one.add_scan(message)
        at_once.add_scan(message)
        expected += one_by_one.placed(is_end=True)
    found = list(at_once.placed(is_end=True))
    assert [len(one.points) for one in found] == [6, 3, 3, 6]
    expected.insert(4, expected.pop(2))  # its frame has two scans, which wait for more to the end
    for member in ("points", "times"):
        both = (np.concatenate([getattr(one, member) for one in some]) for some in (found, expected))
        np.testing.assert_array_equal(*both)
    assert found[0].columns["intensity"].tolist() == [0, 0, 0, 1, 1, 1]


def test_a_scan_that_claims_more_than_it_has_is_refused_and_the_next_placed():
    placer = placing.ScanPlacer(ScanConfig(georeferenced=True))
    rows = np.zeros(2, [(name, "<f4") for name in "xyz"])
    for changes in ({"width": 2**32 - 1}, {"height": 2**31, "row_step": 24}, {"data": b"123"}):
        with pytest.raises(MessageError):
            placer.add_scan(cloud_of(T0, "lidar", rows, **changes))
    placer.add_scan(scan(T0, POINTS))
    assert sum(len(one.points) for one in placer.placed(is_end=True)) == 3
    assert placer.messages == {placing.UNREADABLE: 3}
    assert "3 bytes of data" in placer.refusal


def test_of_two_scanners_on_a_topic_each_is_placed_by_its_own_frame():
    placer = placing.ScanPlacer(ScanConfig(mounting="0,0,1,0,0,0"))
    placer.add_transforms(transforms((0, "base", "right", (0, 0, 2))), is_static=True)
    for second in (0.0, 0.3):
        placer.add_odometry(odometry(stamp(second), (0, 0, 0), child="base"))
    for frame in ("left", "right", "nowhere"):
        placer.add_scan(scan(T0, POINTS, frame=frame))
    heights = [one.points[:, 2].tolist() for one in placer.placed(is_end=True)]
    assert heights == [[1] * 3, [2] * 3, []]
    assert placer.left_out == {placing.NO_WAY: 3}
    assert "'nowhere'" in placer.refusal


def test_a_frame_that_waits_does_not_hold_up_another_one():
    drive = Drive()
    drive.placer.add_scan(scan(stamp(0.1), POINTS, frame="nowhere"))
    drive.poses(0.0, 1.0)
    for number in range(N_SCANS):
        drive.scan(0.1 * number)
    assert len(drive.found) == 3 * N_SCANS
    assert drive.placer.n_waiting == 3


def test_what_waits_is_bounded_by_points_and_by_scans(monkeypatch):
    for name, most in (("MAX_POINTS", 30), ("MAX_SCANS", 10)):
        monkeypatch.setattr(placing, name, most)
    drive = Drive()
    for number in range(15):
        drive.scan(number / 10)
    drive.poses(0.0, 3.0)
    assert sorted(set(drive.end())) == [number / 10 for number in range(5, 15)]
    assert drive.placer.left_out == {placing.WAITED: 15}
    big = Drive()
    big.placer.add_scan(scan(T0, np.ones((100, 3))))
    assert big.placer.n_waiting == 100, "a single one may be as large as it is"


def test_hours_of_a_feed_take_no_memory(monkeypatch):
    monkeypatch.setattr("lidar_buildings.core.scans.placing._MAX_MARKS", 50)
    drive = Drive()
    sizes = []
    for second in range(400):
        drive.pose(second / 4)
        drive.placer.add_scan(scan(stamp(second / 4), POINTS))
        assert sum(len(one.points) for one in drive.placer.placed()) <= 3 * N_SCANS
        edge = drive.placer.tree._edges["lidar"]
        sizes.append((len(edge), len(drive.placer._marks), len(drive.placer._last), drive.placer.n_waiting))
    assert sizes[200] == sizes[-1]
    assert sizes[-1][0] < 50


def static(child, parent="base", place=(0, 0, 0)):
    return transforms((0, parent, child, place))


def test_a_scan_without_a_way_to_what_moves_is_left_out_wherever_poses_begin():
    drive = Drive()
    drive.placer.add_transforms(static("lidar"), is_static=True)
    drive.scan(0.2)
    assert drive.found == []
    for second in np.arange(2.0, 4.0, 0.05):
        drive.placer.add_odometry(odometry(stamp(second), (SPEED * second, 0, 0), child="base"))
    drive.scan(3.0)
    assert drive.end() == [3.0] * 3
    assert drive.placer.left_out == {placing.NO_POSE: 3}


def test_frames_that_nothing_moves_are_no_place_but_in_the_map():
    placer = placing.ScanPlacer()
    placer.add_transforms(static("lidar"), is_static=True)
    placer.add_scan(scan(T0, POINTS))
    assert sum(len(one.points) for one in placer.placed(is_end=True)) == 0
    assert placer.left_out == {placing.NO_WAY: 3}
    assert "in which it moves (frames with poses: base, lidar)" in placer.refusal
    tripod = placing.ScanPlacer()
    tripod.add_transforms(static("lidar", "map", (0, 0, 7)), is_static=True)
    tripod.add_scan(scan(T0, POINTS))
    assert [one.points[:, 2].tolist() for one in tripod.placed(is_end=True)] == [[7] * 3]


@pytest.mark.parametrize("is_static_first", [True, False])
def test_a_frame_that_odometry_moves_keeps_what_is_fixed_to_it_as_its_parent(is_static_first):
    """As some drivers and odometries together tell it: lidar and imu fixed in the sensor, the imu moving."""
    placer = placing.ScanPlacer()
    fixed = transforms((0, "sensor", "imu", (0, 0, 3)), (0, "sensor", "lidar", (0, 0, 5)))
    if is_static_first:
        placer.add_transforms(fixed, is_static=True)
    for second in (0.0, 0.3):
        placer.add_odometry(odometry(stamp(second), (1, 0, 0), child="imu"))
    placer.add_transforms(fixed, is_static=True)
    placer.add_scan(scan(T0, POINTS))
    [found] = placer.placed(is_end=True)
    np.testing.assert_allclose(found.points, POINTS + np.array([1, 0, 2]), atol=1e-9)


def test_all_scans_are_placed_in_one_frame_though_the_map_comes_late():
    def placed(frames):
        placer, found = placing.ScanPlacer(frames=frames), []
        for k in range(20):
            second = 0.1 * k
            placer.add_odometry(odometry(stamp(second), (0, 0, 0), child="lidar"))
            if second > 0.95:
                placer.add_transforms(transforms((stamp(second), "map", "odom", (0, 0, 50))), is_static=False)
            placer.add_scan(scan(stamp(second - 0.15), POINTS))
            found += [z for one in placer.placed() for z in one.points[:, 2]]
        found += [z for one in placer.placed(is_end=True) for z in one.points[:, 2]]
        return placer, found

    first, found = placed(None)
    assert set(found) == {0.0}
    later, found = placed(first.tree)
    assert set(found) == {50.0}
    assert later.left_out[placing.NO_POSE] > 0


@pytest.mark.parametrize("rate", [0.2, 1.0, 10.0])
@pytest.mark.parametrize("gap", [0.0, 2.5, 4.0])
def test_a_chain_is_interpolated_link_by_link_each_by_its_own_rate(rate, gap):
    """`gap` is what messages of the slow link are lacking, in its steps."""
    placer, end, points = placing.ScanPlacer(), 30.0 / rate, 0
    events = [(one, 0, 1.0) for one in np.arange(0.0, end, 1.0 / rate) if not 0 < one * rate - 15.5 < gap]
    events += [(one, 1, SPEED) for one in np.arange(0.0, end, min(0.05, end / 100))]
    events += [(one + 0.1, 2, 0.0) for one in np.arange(1.0, 0.9 * end, end / 50)]
    for second, kind, speed in sorted(events):
        if kind == 2:
            placer.add_scan(scan(stamp(second - 0.1), POINTS))
        else:
            edge = (("map", "odom"), ("odom", "lidar"))[kind]
            move = (stamp(second), *edge, (speed * second, 0, 0))
            placer.add_transforms(transforms(move), is_static=False)
        for one in placer.placed():
            points += len(one.points)
            np.testing.assert_allclose(
                one.points[:, 0] - 5, (SPEED + 1.0) * (one.times - T0) / SECOND, atol=1e-5
            )
    lost = sum(placer.left_out.values())
    assert points + lost > 80
    assert (lost > 0) == (gap > 3.0 and rate < 6.0)
    if lost:
        assert (
            f"'odom' in 'map' (one every {1 / rate:g} s) have gaps of up to {5 / rate:g} s"
            in placer.why_no_pose()
        )


def test_poses_of_two_senders_and_such_as_come_too_seldom_are_told_of():
    drive = Drive()
    for second in np.arange(0.0, 2.0, 0.05):
        drive.pose(second)
        drive.pose(second + 0.025, x=SPEED * (second + 0.025) + 0.5)
    assert "are 0.50 m and 0.00° off what lies between" in drive.placer.tree.doubts[0]
    smooth = Drive()
    smooth.poses(0.0, 4.0)
    assert smooth.placer.tree.doubts == []


@pytest.mark.parametrize("ahead", [18, -18, 37, -37])
def test_scans_whole_seconds_ahead_of_the_poses_are_set_back(ahead):
    drive = Drive()
    for second in np.arange(0.0, 40.0, 0.05):
        drive.pose(second)
        if round(second * 20) % 4 == 0 and second >= 0.1:
            drive.scan(second - 0.1, clock=float(ahead))
    seconds = drive.end()
    assert len(seconds) >= 3 * 195
    assert f"is {ahead:+} s ahead of that of the poses" in drive.placer.doubts[0]


@pytest.mark.parametrize("n_before", [18, 18.5])
def test_poses_that_all_come_first_are_of_no_other_clock(n_before):
    drive = Drive()
    drive.poses(0.0, n_before + 2.0)
    for second in np.arange(2.0, n_before, 0.2):
        drive.scan(second)
    assert len(drive.end()) > 3 * 75
    assert drive.placer.doubts == []


def placer_of(n_scans, frames):
    """Return a placer that knows poses of frames until after so many scans of 10 Hz."""
    placer = placing.ScanPlacer()
    for k in range(n_scans + 2):
        for child in frames:
            told = transforms((T0 + k * SECOND // 10, "map", child, (k, 0.0, 0.0)))
            placer.add_transforms(told, is_static=False)
    return placer


@pytest.mark.parametrize("first", [0, 7])
def test_few_scans_of_another_frame_or_with_other_times_are_left_out_and_counted(first):
    placer = placer_of(60, ["lidar", "other"])
    for k in range(60):
        frame = "other" if k in (first, first + 20) else "lidar"
        kind = "<f8" if k == first + 40 else "<f4"
        placer.add_scan(scan(T0 + k * SECOND // 10, POINTS, frame, kind=kind))
    assert sum(len(one.points) for one in placer.placed(is_end=True)) == 57 * len(POINTS)
    assert placer.left_out == {placing.OTHER_FORM: 3 * len(POINTS)}
    assert sorted(placer.messages.values()) == [1, 2]


def test_scans_of_several_scanners_and_a_change_for_good_are_all_placed():
    frames = ["front", "front", "rear", "front", "front"] * 12 + ["new"] * 20
    placer = placer_of(len(frames), set(frames))
    for k, frame in enumerate(frames):
        placer.add_scan(scan(T0 + k * SECOND // 10, POINTS, frame=frame))
    assert sum(len(one.points) for one in placer.placed(is_end=True)) == len(frames) * len(POINTS)
    assert not placer.left_out
