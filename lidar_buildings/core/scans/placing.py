"""Scans as they come, and satellites' antennas, placed in the map as soon as their poses are known."""

from __future__ import annotations

from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.motion import place_points
from lidar_buildings.core.scans.point_times import TopicTimes
from lidar_buildings.core.scans.scan import (
    NO_RETURN,
    NOT_FINITE,
    PlacedScan,
    Scan,
    is_alike,
    joined,
    mark_of,
    read_scan,
    stamp_of,
    timed,
)
from lidar_buildings.core.scans.seen_points import SeenPoints
from lidar_buildings.core.scans.topic_forms import Form, TopicForms
from lidar_buildings.core.scans.trajectory import Loss, Pose
from lidar_buildings.core.scans.transform_tree import (
    MAX_FRAMES,
    SET_BACK,
    ClockWatch,
    ScanClock,
    TransformTree,
    frame_name,
    why_no_way,
)
from lidar_buildings.core.scans.viewpoint import view_from

#: Why points are left out, in words; those of `scan` beside.
NO_POSE = "no pose at their time"
NO_WAY = "no pose leads from their frame to another one"
WAITED = "waited too long for poses"
OTHER_FORM = "scan is of another frame, or has other times, than most of its topic"
#: Why messages are left out, and what else they tell, in words.
TWICE = "scans that came twice"
UNREADABLE = "scans that cannot be read"
NO_POSES = "poses that are none (not finite, off the Earth, no rotation)"
TOO_FAST = "steps from pose to pose faster than scan_assembler.max_speed, one of {:,.0f} m/s"
CLOCK_SET_BACK = "times that the clock was set back"
TWO_CLOCKS = "messages of a second, earlier clock, left out: two sources on the same topics"
_OTHER_FORM = "scans {}, unlike most of their topic, left out"
_OTHER_CLOCK = (
    "the clock of scans of {!r} is {:+} s ahead of that of the poses, as GPS or TAI of UTC: corrected"
)
#: Poses are kept so long before the scan that was placed last [ns]: one may come so much later than others.
_KEPT_POSES = 10_000_000_000
#: Between two places of a scanner's way [ns].
_WAY_STEP = 50_000_000
#: Points that are placed at once: each takes a pose.
_BATCH = 1_000_000
#: Scans among which one that comes twice is found: minutes to an hour.
_MAX_MARKS = 10_000


#: Points that may wait: a second of the fastest scanners, half a minute of others; 0.5 GB.
MAX_POINTS = 10_000_000
#: Scans that may wait, however small.
MAX_SCANS = 50_000


class WaitingScans:
    """Scans that wait, with `n_points` points, those of each frame in the order in which they came."""

    def __init__(self) -> None:
        self._by_frame: dict[str, deque[tuple[int, Scan]]] = {}
        self._n_came = self._n_scans = self.n_points = 0

    @property
    def are_too_many(self) -> bool:
        """Whether the first has to go; a single one may be as large as it is."""
        return self._n_scans > 1 and (self.n_points > MAX_POINTS or self._n_scans > MAX_SCANS)

    @property
    def oldest(self) -> Scan | None:
        """The scan that has waited longest, None if none waits."""
        return min((queue[0] for queue in self._by_frame.values()), default=(0, None), key=itemgetter(0))[1]

    def add(self, scan: Scan) -> None:
        """Let a scan wait."""
        self._by_frame.setdefault(scan.frame, deque()).append((self._n_came, scan))
        self._n_came += 1
        self._n_scans += 1
        self.n_points += len(scan.times)

    def take_joined(self, is_due: Callable[[Scan], bool]) -> Scan | None:
        """Remove and return as one the next scans that are due, of one frame and with the same columns."""
        scans: list[Scan] = []
        while (scan := self.take(is_due, lambda one: not scans or is_alike(one, scans[0]))) is not None:
            scans.append(scan)
        return joined(scans) if scans else None

    def take(
        self,
        is_due: Callable[[Scan], bool] = lambda scan: True,
        is_wanted: Callable[[Scan], bool] = lambda scan: True,
    ) -> Scan | None:
        """
        Remove and return the first scan that is due, None if none is, or that one is not wanted.

        None passes another of its frame.
        """
        for _, frame in sorted((queue[0][0], frame) for frame, queue in self._by_frame.items()):
            queue = self._by_frame[frame]
            if is_due(queue[0][1]):
                if not is_wanted(queue[0][1]):
                    return None
                _, scan = queue.popleft()
                if not queue:
                    del self._by_frame[frame]
                self._n_scans -= 1
                self.n_points -= len(scan.times)
                return scan
        return None


class ScanPlacer:
    """
    Places scans in the map.

    Poses and scans may come in any order; a scan waits until the poses reach beyond its last point. Each
    point is placed by the pose at its own time, so that the sensor's motion within a scan is taken out. What
    is kept is bounded, so that this can go on for ever.

    `seen` leaves out the points of our own tiles that were in an earlier sending of them. Where all `frames`
    that will be told of are known beforehand, scans are placed in the last of them. `left_out` leads from a
    reason to points, `n_scans` counts the scans that came; `refusal` is why the last scan was refused that
    could not be read or has no pose, `unreadable` why the last that could not be read, empty if none was.
    `odometry_child` is the frame that odometry moves, empty if none has come.
    """

    def __init__(
        self,
        config: ScanConfig | None = None,
        seen: SeenPoints | None = None,
        frames: TransformTree | None = None,
    ) -> None:
        self.config = config or ScanConfig()
        gap, speed, wanted = self.config.max_pose_gap, self.config.max_speed, self.config.map_frame
        self.tree = TransformTree(gap, speed, wanted, frames)
        self.left_out: Counter[str] = Counter()
        self.n_scans = 0
        self.refusal = self.unreadable = ""
        self._seen = seen
        self._frames = frames
        self._targets: OrderedDict[str, str] = OrderedDict()
        self._messages: Counter[str] = Counter()
        self._waiting = WaitingScans()
        self._of_before: list[PlacedScan] = []
        self._marks: OrderedDict[tuple[str, int, int, int], None] = OrderedDict()
        self._last: OrderedDict[str, int] = OrderedDict()
        self._clocks = ClockWatch()
        self._forms = TopicForms()
        self._topics: OrderedDict[Form, TopicTimes] = OrderedDict()
        self._clock_of: OrderedDict[str, ScanClock] = OrderedDict()
        self._losses: dict[tuple[str, str], Loss] = {}
        self.odometry_child = ""
        self._mounting = self.config.mounting_pose()
        self._mounted = ""

    @property
    def n_waiting(self) -> int:
        """Points that wait for poses, or for scans that tell what their times mean, or whose they are."""
        untimed = (len(times.values) for topic in self._topics.values() for _, times in topic.waiting)
        return self._waiting.n_points + sum(untimed) + self._forms.n_waiting

    @property
    def target(self) -> str:
        """The frame in which the last scan was placed, empty if none was."""
        return next(reversed(self._targets.values()), "")

    @property
    def messages(self) -> Counter[str]:
        """What is to be said of messages: reason → how many."""
        n_jumps, speed = self.tree.jumps
        return self._messages + Counter({NO_POSES: self.tree.n_refused, TOO_FAST.format(speed): n_jumps})

    def add_odometry(self, message: Any) -> None:
        """Take a nav_msgs/Odometry."""
        pose = message.pose.pose
        self.odometry_child = frame_name(message.child_frame_id)
        self._add_pose(message.header, message.child_frame_id, _pose(pose.position, pose.orientation))

    def add_transforms(self, message: Any, *, is_static: bool) -> None:
        """Take a tf2_msgs/TFMessage of /tf or /tf_static."""
        for one in message.transforms:
            pose = _pose(one.transform.translation, one.transform.rotation)
            if is_static:
                self.tree.add_static(one.header.frame_id, one.child_frame_id, pose)
            elif frame_name(one.child_frame_id) != self.odometry_child:
                self._add_pose(one.header, one.child_frame_id, pose)

    def add_scan(self, message: Any) -> None:
        """
        Take a sensor_msgs/PointCloud2; one that came before is left out.

        MessageError if its layout contradicts itself, it has no x, y and z, no unit makes its times and those
        of scans before it a scan's, or it is of a second clock.
        """
        self.n_scans += 1
        mark = mark_of(message)
        if mark in self._marks:
            self._messages[TWICE] += 1
            return
        stamp, frame = stamp_of(message.header), frame_name(message.header.frame_id)
        is_earlier = stamp < self._last.get(frame, stamp) - SET_BACK
        if self._is_of_another_clock(is_earlier=is_earlier):
            raise MessageError(TWO_CLOCKS)
        with self._refusing(1):
            scan = read_scan(message, self.left_out, self._seen)
        _keep(self._marks, mark, None, _MAX_MARKS)
        if is_earlier:
            self._set_back(stamp)
        _keep(self._last, frame, stamp, MAX_FRAMES)
        until = self.tree.known_until(frame, self.target_of(frame))
        if until:
            clock = self._clock_of.get(frame) or ScanClock()
            clock.note(stamp, until)
            _keep(self._clock_of, frame, clock, MAX_FRAMES)
        if self._is_placed(scan):
            self._learn_times(scan)
            return
        for one in self._forms.take(scan):
            self._learn_times(one)
        self._leave_out_others()

    def _leave_out_others(self, *, is_end: bool = False) -> None:
        """Leave out scans that are not like those of their topic."""
        for scan in self._forms.refused(is_end=is_end):
            self._messages[_OTHER_FORM.format(Form.of(scan))] += 1
            self._leave_out(OTHER_FORM, len(scan.times))

    def _learn_times(self, scan: Scan) -> None:
        """Have a scan wait until it is known what its times mean, then for poses."""
        if scan.told is None or not len(scan.times):
            self._wait_for_poses(scan)
            return
        key = Form.of(scan)
        if key not in self._topics:
            unit = "" if self.config.time_unit == "auto" else self.config.time_unit
            _keep(self._topics, key, TopicTimes(scan.time_field, unit), MAX_FRAMES)
        topic = self._topics[key]
        with self._refusing(len(topic.waiting) + 1):
            for one in topic.take(scan, scan.told):
                self._wait_for_poses(timed(one, self.left_out))

    @property
    def doubts(self) -> list[str]:
        """What is doubtful of poses and clocks, each once."""
        ahead = {frame: clock.ahead for frame, clock in self._clock_of.items() if clock.ahead}
        return self.tree.doubts + [_OTHER_CLOCK.format(frame, by) for frame, by in ahead.items()]

    def _ahead(self, frame: str) -> int:
        """Return by how much scans of a frame are ahead of the poses [ns]."""
        clock = self._clock_of.get(frame)
        return 0 if clock is None else clock.ahead * 1_000_000_000

    def _end_waiting_for_times(self) -> None:
        """Have no scan wait any longer for others that tell what its times mean."""
        for scan in self._forms.rest():
            with suppress(MessageError):
                self._learn_times(scan)
        self._leave_out_others(is_end=True)
        for topic in self._topics.values():
            with suppress(MessageError), self._refusing(len(topic.waiting)):
                for one in topic.rest():
                    self._wait_for_poses(timed(one, self.left_out))

    def _wait_for_poses(self, scan: Scan) -> None:
        self._messages.update(scan.doubts)
        self._waiting.add(scan)
        while self._waiting.are_too_many and (oldest := self._waiting.take()) is not None:
            self._leave_out(WAITED, len(oldest.times))

    @contextmanager
    def _refusing(self, n_scans: int) -> Iterator[None]:
        """Note why so many scans are refused, if they are."""
        try:
            yield
        except MessageError as error:
            self._messages[UNREADABLE] += n_scans
            self.refusal = self.unreadable = str(error)
            raise

    def placed(self, *, is_end: bool = False) -> Iterator[PlacedScan]:
        """
        Return the scans that can be placed, in the order in which they came; each frame has its own.

        Such as follow one another in one frame, with the same columns, are placed as one: a small scan costs
        more than its points. At the end, when no more poses come, what has none yet is left out and counted.
        """
        if is_end:
            self._end_waiting_for_times()
        while self._of_before:
            yield self._of_before.pop(0)
        while (scan := self._waiting.take_joined(lambda one: is_end or self._is_due(one))) is not None:
            yield self._place(scan)
            if len(scan.times):
                self.tree.drop_before(int(scan.times.min()) - self._ahead(scan.frame) - _KEPT_POSES)

    def why_waiting(self) -> str:
        """Say what the scan that has waited longest waits for, empty if none waits."""
        if (scan := self._waiting.oldest) is None:
            return ""
        if (target := self.target_of(scan.frame)) == scan.frame:
            return why_no_way(scan.frame, self.tree)
        late = (
            int(scan.times.max(initial=0))
            - self._ahead(scan.frame)
            - (self.tree.known_until(scan.frame, target) or 0)
        )
        return (
            f"scans of {scan.frame!r} wait: they are {late / 1e9:,.1f} s later than the last pose of it; "
            "poses have ended, or are of another clock"
        )

    def why_no_pose(self) -> str:
        """Say which link of frames lacks most poses of the points that have none, and what can be done."""
        if not self._losses:
            return ""
        link, loss = max(self._losses.items(), key=lambda one: sum(one[1][:3]))
        (child, parent), (step, filled) = link, self.tree.usual_step(link[0])
        often = f" (one every {step:.2g} s)" if step else ""
        whose = f"poses of {child!r} in {parent!r}{often}"
        most = max(loss.n_outside, loss.n_in_gaps, loss.n_at_jumps)
        if most == loss.n_in_gaps:
            return (
                f"{whose} have gaps of up to {loss.gap:.3g} s, {filled:.2g} s are filled: record them "
                "without gaps, or raise scan_assembler.max_pose_gap"
            )
        if most == loss.n_at_jumps:
            return f"{whose} jump: check them, or raise scan_assembler.max_speed"
        return (
            f"{whose} begin after, or end before these points, by up to {loss.outside:.3g} s: record them "
            "for as long, and by the same clock"
        )

    def why_left_out(self, left_out: Counter[str]) -> str:
        """Say why most of the points are left out that were measured, and what can be done."""
        why = max(_lost(left_out).items(), key=itemgetter(1), default=("", 0))[0]
        return {NO_POSE: f"{NO_POSE}: {self.why_no_pose()}", NO_WAY: self.refusal}.get(why, why)

    def target_of(self, frame: str) -> str:
        """
        Return the frame in which scans of a frame are placed, itself if there is none yet.

        It is one for all of them: the map frame, if it is told of when the first is placed, else the last one
        on the way up. What nothing moves in lies still, and is no place but in the map.
        """
        wanted = frame_name(self.config.map_frame)
        target = self._targets.get(frame)
        if target is None:
            known = self.tree if self._frames is None else self._frames
            target = wanted if known.has_way(frame, wanted) else known.root_of(frame)
        is_told = self.tree.has_way(frame, target) and (target == wanted or self.tree.moves(frame, target))
        return target if is_told else frame

    def _add_pose(self, header: Any, child: str, pose: Pose) -> None:
        stamp = stamp_of(header)
        is_earlier = pose.is_valid and self.tree.is_set_back(child, stamp)
        if self._is_of_another_clock(is_earlier=is_earlier):
            return
        if is_earlier:
            self._set_back(stamp)
        self.tree.add(header.frame_id, child, stamp, pose)

    def _is_of_another_clock(self, *, is_earlier: bool) -> bool:
        is_of_another = self._clocks.is_of_another(is_earlier=is_earlier)
        self._messages[TWO_CLOCKS] += is_of_another
        return is_of_another

    def _set_back(self, stamp: int) -> None:
        """Place what waits of the time before the clock was set back, and forget the poses of that time."""
        self._messages[CLOCK_SET_BACK] += 1
        end = stamp + SET_BACK
        self._end_waiting_for_times()
        while (scan := self._waiting.take(lambda one: one.times.max(initial=stamp) > end)) is not None:
            self._of_before.append(self._place(scan))
        self.tree.set_back(stamp)
        self._last.clear()

    def _is_due(self, scan: Scan) -> bool:
        if self._is_placed(scan):
            return True
        self._mount(scan.frame)
        if self.target_of(scan.frame) == scan.frame:
            return False  # nothing tells yet where it is
        target = self.target_of(scan.frame)
        until = self.tree.known_until(scan.frame, target)
        if until is None:
            return True
        if scan.frame in self._clock_of and self._clock_of[scan.frame].is_doubtful:
            return False
        last = int(scan.times.max()) - self._ahead(scan.frame)
        return until >= last and not self.tree.is_young(scan.frame, target)

    def _is_placed(self, scan: Scan) -> bool:
        """Whether a scan needs no pose."""
        is_in_map = self.config.georeferenced or scan.frame == frame_name(self.config.map_frame)
        return is_in_map or not len(scan.times)

    def _mount(self, frame: str) -> None:
        """Fix the scanner where the parameter says; it holds for one: the first."""
        child = self.odometry_child
        if self._mounting is not None and child and child != frame and self._mounted in ("", frame):
            self._mounted = frame
            for tree in filter(None, (self.tree, self._frames)):
                tree.set_fixed(child, frame, self._mounting)

    def _place(self, scan: Scan) -> PlacedScan:
        if self._is_placed(scan):
            return PlacedScan(scan.points, scan.times, scan.columns)
        self._mount(scan.frame)
        target = self.target_of(scan.frame)
        if target == scan.frame:
            self._leave_out(NO_WAY, len(scan.times))
            self.refusal = why_no_way(scan.frame, self.tree)
            none = np.zeros(0, dtype=np.intp)
            return PlacedScan(scan.points[none], scan.times[none], {})
        _keep(self._targets, scan.frame, target, MAX_FRAMES)
        scan = scan._replace(times=scan.times - self._ahead(scan.frame))
        points, is_known = np.empty_like(scan.points), np.empty(len(scan.times), dtype=np.bool_)
        view = np.zeros(len(scan.times), dtype=np.uint8)
        stamps = self.tree.stamps(scan.frame, target)
        look_up = partial(self.tree.poses, scan.frame, target)
        for begin in range(0, len(points), _BATCH):
            own = slice(begin, begin + _BATCH)
            points[own], is_known[own] = place_points(look_up, stamps, scan.times[own], scan.points[own])
            if len(known := begin + np.flatnonzero(is_known[own])):
                view[known] = view_from(look_up, scan.times[known], points[known])
        if not is_known.all():
            self._leave_out(NO_POSE, len(points) - np.count_nonzero(is_known))
            for link, loss in self.tree.losses(scan.frame, target, scan.times[~is_known]).items():
                self._losses[link] = loss.joined(self._losses[link]) if link in self._losses else loss
        columns = {name: values.compress(is_known) for name, values in {**scan.columns, "view": view}.items()}
        times = scan.times.compress(is_known)
        first = np.unique(times // _WAY_STEP, return_index=True)[1]
        way = look_up(times[first]).translation if len(first) else np.empty((0, 3))
        return PlacedScan(points.compress(is_known, axis=0), times, columns, way)

    def _leave_out(self, reason: str, n_points: Any) -> None:
        if n_points:
            self.left_out[reason] += int(n_points)


def lost_share(left_out: Counter[str], n_placed: int) -> float:
    """Return which share of the points that were measured is left out."""
    n_lost = sum(_lost(left_out).values())
    return n_lost / max(n_lost + n_placed, 1)


def _lost(left_out: Counter[str]) -> dict[str, int]:
    return {why: n for why, n in left_out.items() if why not in (NOT_FINITE, NO_RETURN)}


def _keep(kept: OrderedDict[Any, Any], key: Any, value: Any, most: int) -> None:
    """Keep a value as the newest, and of all the newest ones."""
    kept[key] = value
    kept.move_to_end(key)
    while len(kept) > most:
        kept.popitem(last=False)


def _pose(place: Any, attitude: Any) -> Pose:
    return Pose(
        (float(place.x), float(place.y), float(place.z)),
        (float(attitude.x), float(attitude.y), float(attitude.z), float(attitude.w)),
    )


#: What moves, where nothing but /tf tells of it (REP-105).
_BODY = "base_link"


class Antenna(NamedTuple):
    """An antenna on what the poses move."""

    frame: str  #: where it is fixed
    target: str  #: the frame in which scans are placed
    place: tuple[float, float, float]  #: in its frame [m]

    @classmethod
    def of(cls, frame: str, placer: ScanPlacer) -> Antenna | None:
        """
        Return the antenna whose positions are told in a frame, None if nothing tells how that moves.

        The frame counts if transforms tell of it, but not that it moves against what odometry moves, or
        `base_link`, and the parameter `antenna` is empty; else the antenna is at the origin of that.
        """
        tree, body = placer.tree, placer.odometry_child or _BODY
        is_other = frame not in tree.frames or (tree.has_way(frame, body) and tree.moves(frame, body))
        own = body if is_other or placer.config.antenna.strip() else frame
        target = placer.target or placer.target_of(own)
        if not (tree.has_way(own, target) and tree.moves(own, target)):
            return None
        return cls(own, target, placer.config.antenna_place())

    def places(
        self, placer: ScanPlacer, times: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return where it was at some times [ns], shape (n, 3) [m], and whether that is known."""
        poses = placer.tree.poses(self.frame, self.target, times)
        return poses.apply(np.tile(self.place, (len(times), 1))), poses.is_known

    def known_until(self, placer: ScanPlacer) -> int:
        """Return the time of the last pose that tells of it [ns]."""
        return placer.tree.known_until(self.frame, self.target) or 0
