"""Where a frame was in its parent, at any time between its poses."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidar_buildings.core.model.bounds import MAX_COORDINATE

_NANOSECONDS = 1e9
#: Poses that are kept of a frame: a quarter of an hour at 200 Hz, where nothing else forgets them.
MAX_POSES = 200_000
#: How far a quaternion's length may be from 1; wide margin over single precision.
_MAX_NORM_ERROR = 0.1
#: New poses are sorted in at the latest when they are so many.
_BATCH = 10_000
#: By so many last poses it is told how often they come: of these steps a tenth may be gaps, or nine in ten
#: those within bursts.
_RECENT, _USUAL_SHARE = 21, 0.9
#: A gap of so many usual steps is filled, too: two messages in a row may be lost.
_STEPS_FILLED = 3.0
#: Poses that lie so far from what their neighbours say of them are to be told of [m], [deg].
_ROUGH, _ROUGH_TURN = 0.2, math.radians(0.5)
#: Poses that are compared with their neighbours: at least, and at most the last ones.
_LEAST_OFF, _MOST_OFF = 19, 1_000


class Poses(NamedTuple):
    """Poses of one frame in another, one per time."""

    translation: NDArray[np.float64]  #: position of the frame's origin [m], shape (n, 3)
    rotation: Rotation  #: n rotations from the frame into the other one
    is_known: NDArray[np.bool_]  #: whether there is a pose at that time, shape (n,)

    def after(self, first: Poses) -> Poses:
        """Return the poses of `first`'s frame in the frame that these lead to."""
        is_known = self.is_known & first.is_known
        return Poses(self.apply(first.translation), self.rotation * first.rotation, is_known)

    def inverted(self) -> Poses:
        """Return the poses the other way round."""
        back = self.rotation.inv()
        return Poses(-back.apply(self.translation), back, self.is_known)

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn points of the frame, one per pose, into the other frame."""
        return np.asarray(self.rotation.apply(points) + self.translation)


class Pose(NamedTuple):
    """One pose that holds for ever: position [m] and quaternion (x, y, z, w)."""

    translation: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]

    @property
    def is_valid(self) -> bool:
        """Whether it is a place on or near the Earth, and a rotation."""
        is_place = all(abs(one) <= MAX_COORDINATE for one in self.translation)
        return is_place and abs(math.hypot(*self.quaternion) - 1.0) <= _MAX_NORM_ERROR

    def inverted(self) -> Pose:
        """Return the pose of the one frame in the other."""
        back = self.at(np.zeros(1, dtype=np.int64)).inverted()
        return Pose(tuple(back.translation[0].tolist()), tuple(back.rotation.as_quat()[0].tolist()))

    def at(self, times: NDArray[np.int64]) -> Poses:
        """Return the pose for each time."""
        n = len(times)
        rotation = Rotation.from_quat(np.tile(self.quaternion, (n, 1)))
        return Poses(np.tile(self.translation, (n, 1)), rotation, np.ones(n, dtype=np.bool_))


class Loss(NamedTuple):
    """Times at which a trajectory has no pose, by why it has none."""

    n_outside: int  #: before its first, or after its last pose
    n_in_gaps: int  #: between two poses too far apart in time
    n_at_jumps: int  #: between two poses too far apart in space
    outside: float  #: how far the times are before its first or after its last pose at most [s]
    gap: float  #: the longest of these gaps [s]

    def joined(self, other: Loss) -> Loss:
        """Return what both say."""
        return Loss(
            self.n_outside + other.n_outside,
            self.n_in_gaps + other.n_in_gaps,
            self.n_at_jumps + other.n_at_jumps,
            max(self.outside, other.outside),
            max(self.gap, other.gap),
        )


class Trajectory:
    """
    Poses by time, and what lies between them: positions on lines, attitudes by slerp (Shoemake 1985).

    The last `MAX_POSES` are kept, `last` is the time of the last one [ns]. Times of up to `max_gap` [s]
    between two poses are filled, and of up to three usual steps of the last poses; two further apart than
    `max_speed` [m/s] allows are of two tracks, and nothing lies between them: `n_jumps` counts such steps,
    `first_jump` is the speed of the first [m/s].
    """

    def __init__(self, max_gap: float, max_speed: float) -> None:
        self._max_gap = max_gap
        self._max_speed = max_speed
        self._stamps = np.empty(0, dtype=np.int64)
        self._poses = np.empty((0, 7))
        self._new: list[tuple[int, Pose]] = []
        self._recent = np.empty(0, dtype=np.int64)
        self._off: deque[tuple[float, float]] = deque(maxlen=_MOST_OFF)
        self._n_to_compare = 0
        self.last: int | None = None
        self.n_jumps, self.first_jump = 0, 0.0

    def __len__(self) -> int:
        self._sort_in()
        return len(self._stamps)

    @property
    def stamps(self) -> NDArray[np.int64]:
        """Times of the poses that are kept [ns]."""
        self._sort_in()
        return self._stamps

    def add(self, stamp: int, pose: Pose) -> None:
        """Add a valid pose; a later one of the same time replaces it."""
        self._new.append((stamp, pose))
        self.last = stamp if self.last is None else max(stamp, self.last)
        if len(self._new) >= _BATCH:
            self._sort_in()

    @property
    def usual_step(self) -> float:
        """Time from pose to pose of the last ones, but for a few gaps [s]; 0 if these are less than three."""
        self._sort_in()
        steps = np.sort(np.diff(self._recent))
        return float(steps[int(_USUAL_SHARE * (len(steps) - 1))]) / _NANOSECONDS if len(steps) > 1 else 0.0

    @property
    def filled(self) -> float:
        """The longest time between two poses that is filled [s]."""
        return max(self._max_gap, _STEPS_FILLED * self.usual_step)

    @property
    def span(self) -> tuple[int, int]:
        """Times of the first and the last pose that are kept [ns]."""
        return (int(self.stamps[0]), int(self.stamps[-1])) if len(self) else (0, 0)

    @property
    def covered(self) -> float:
        """How much time has poses [s]."""
        steps = np.diff(self.stamps) / _NANOSECONDS
        return round(float(steps[steps <= self.filled].sum()), 1)

    @property
    def roughness(self) -> tuple[float, float] | None:
        """How far poses are from what their neighbours say of them [m] and [rad]; None if that is little."""
        self._sort_in()
        if len(self._off) < _LEAST_OFF:
            return None
        place, turn = np.median(np.array(self._off), axis=0).tolist()
        return (place, turn) if place > _ROUGH or turn > _ROUGH_TURN else None

    @property
    def is_young(self) -> bool:
        """Whether the next pose may tell that the gap between the only two is usual."""
        self._sort_in()
        return len(self._recent) == 2 and int(np.ptp(self._recent)) > self._max_gap * _NANOSECONDS

    def drop_before(self, stamp: int) -> None:
        """Forget poses that no later time needs: all but the last one before a time."""
        self._sort_in()
        first = max(int(np.searchsorted(self._stamps, stamp, side="right")) - 1, 0)
        self._stamps, self._poses = self._stamps[first:], self._poses[first:]

    def set_back(self, stamp: int) -> None:
        """Forget poses that lie after a time, or so near before it that what is between would be filled."""
        self._sort_in()
        n = int(np.searchsorted(self._stamps, stamp - round(self._max_gap * _NANOSECONDS)))
        self._stamps, self._poses = self._stamps[:n], self._poses[:n]
        self._recent = self._stamps[-_RECENT:]
        self.last = int(self._stamps[-1]) if n else None

    def at(self, times: NDArray[np.int64]) -> Poses:
        """Return the pose at each time, shape (n,) [ns]."""
        if not len(self):
            nowhere = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)).at(times)
            return nowhere._replace(is_known=np.zeros(len(times), dtype=np.bool_))
        stamps, places = self._stamps, self._poses[:, :3]
        left, right = self._around(times)
        step, since = stamps[right] - stamps[left], times - stamps[left]
        share = np.clip(np.divide(since, step, out=np.zeros(len(times)), where=step > 0), 0.0, 1.0)
        start, end = (Rotation.from_quat(self._poses[rows, 3:]) for rows in (left, right))
        turn = (start.inv() * end).as_rotvec()  # the shorter way
        return Poses(
            places[left] + share[:, None] * (places[right] - places[left]),
            start * Rotation.from_rotvec(share[:, None] * turn),
            np.logical_not(np.logical_or.reduce(self._lacking(times, left, right))),
        )

    def loss(self, times: NDArray[np.int64]) -> Loss:
        """Return at how many of some times [ns], one at least, there is no pose, and why."""
        if not len(self):
            return Loss(len(times), 0, 0, 0.0, 0.0)
        left, right = self._around(times)
        lacking = self._lacking(times, left, right)
        beyond = np.maximum(self._stamps[0] - times, times - self._stamps[-1]).max() / _NANOSECONDS
        gap = (self._stamps[right] - self._stamps[left])[lacking[1]].max(initial=0) / _NANOSECONDS
        n_outside, n_in_gaps, n_at_jumps = (int(np.count_nonzero(one)) for one in lacking)
        return Loss(n_outside, n_in_gaps, n_at_jumps, max(float(beyond), 0.0), float(gap))

    def _around(self, times: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the poses before and after each time."""
        n = len(self._stamps)
        right = np.clip(np.searchsorted(self._stamps, times), min(1, n - 1), n - 1)
        return np.maximum(right - 1, 0), right

    def _lacking(
        self, times: NDArray[np.int64], left: NDArray[np.intp], right: NDArray[np.intp]
    ) -> tuple[NDArray[np.bool_], ...]:
        """Tell which times are outside, which in gaps, and which at jumps; none is two of them."""
        stamps, places = self._stamps, self._poses[:, :3]
        is_outside = (times < stamps[0]) | (times > stamps[-1])
        is_between = ~is_outside & (times != stamps[left]) & (times != stamps[right])
        span = (stamps[right] - stamps[left]) / _NANOSECONDS
        is_in_gap = is_between & (span > self.filled)
        is_jump = np.linalg.norm(places[right] - places[left], axis=1) > self._max_speed * span
        return is_outside, is_in_gap, is_between & ~is_in_gap & is_jump

    def _sort_in(self) -> None:
        if not self._new:
            return
        new = np.array([stamp for stamp, _ in self._new], dtype=np.int64)
        stamps = np.concatenate([self._stamps, new])
        poses = np.array([(*pose.translation, *pose.quaternion) for _, pose in self._new], dtype=np.float64)
        order = np.argsort(stamps, kind="stable")
        is_last = np.append(np.diff(stamps[order]) > 0, True)
        kept = order[is_last][-MAX_POSES:]
        self._stamps, self._poses = stamps[kept], np.concatenate([self._poses, poses])[kept]
        self._recent = np.unique(np.concatenate([self._recent, new]))[-_RECENT:]
        self._new.clear()
        self._count_jumps(int(np.searchsorted(self._stamps, new.min())))
        self._n_to_compare += len(new)
        self._compare()

    def _count_jumps(self, first: int) -> None:
        """Count the steps to the first new pose, and from there, that are too fast."""
        begin = max(first - 1, 0)
        span = np.diff(self._stamps[begin:]) / _NANOSECONDS
        speed = np.linalg.norm(np.diff(self._poses[begin:, :3], axis=0), axis=1) / span
        is_jump = (span <= self.filled) & (speed > self._max_speed)
        if is_jump.any():
            self.first_jump = self.first_jump or float(speed[is_jump][0])
            self.n_jumps += int(np.count_nonzero(is_jump))

    def _compare(self) -> None:
        """Note how far the last poses are from what their neighbours say, some at a time."""
        if min(self._n_to_compare, len(self._stamps)) < _RECENT:
            return
        begin, self._n_to_compare = max(len(self._stamps) - self._n_to_compare - 2, 0), 0
        places, turned = self._poses[begin:, :3], Rotation.from_quat(self._poses[begin:, 3:])
        span = np.diff(self._stamps[begin:]) / _NANOSECONDS
        share = (span[:-1] / (span[:-1] + span[1:]))[:, None]
        away = places[1:-1] - places[:-2] - share * (places[2:] - places[:-2])
        turn = (turned[:-2].inv() * turned[2:]).as_rotvec()
        off = (turned[:-2] * Rotation.from_rotvec(share * turn)).inv() * turned[1:-1]
        self._off.extend(zip(np.linalg.norm(away, axis=1), off.magnitude(), strict=True))
