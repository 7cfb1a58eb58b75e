"""Where a frame was in its parent, at any time between its poses."""

from __future__ import annotations

import math
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


class Trajectory:
    """
    Poses by time, and what lies between them: positions on lines, attitudes by slerp (Shoemake 1985).

    The last `MAX_POSES` are kept, `last` is the time of the last one [ns]. Times of up to `max_gap` [s]
    between two poses are filled; two further apart than `max_speed` [m/s] allows are of two tracks, and
    nothing lies between them: `n_jumps` counts such steps, `first_jump` is the speed of the first [m/s].
    """

    def __init__(self, max_gap: float, max_speed: float) -> None:
        self._max_gap = max_gap
        self._max_speed = max_speed
        self._stamps = np.empty(0, dtype=np.int64)
        self._poses = np.empty((0, 7))
        self._new: list[tuple[int, Pose]] = []
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
        self.last = int(self._stamps[-1]) if n else None

    def at(self, times: NDArray[np.int64]) -> Poses:
        """Return the pose at each time, shape (n,) [ns]."""
        n = len(self)
        if not n:
            nowhere = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)).at(times)
            return nowhere._replace(is_known=np.zeros(len(times), dtype=np.bool_))
        stamps, places = self._stamps, self._poses[:, :3]
        right = np.clip(np.searchsorted(stamps, times), min(1, n - 1), n - 1)
        left = np.maximum(right - 1, 0)
        step = stamps[right] - stamps[left]
        move = places[right] - places[left]
        since = times - stamps[left]
        share = np.clip(np.divide(since, step, out=np.zeros(len(times)), where=step > 0), 0.0, 1.0)
        is_inside = (times >= stamps[0]) & (times <= stamps[-1])
        is_exact = (times == stamps[left]) | (times == stamps[right])
        span = step / _NANOSECONDS
        is_filled = (span <= self._max_gap) & (np.linalg.norm(move, axis=1) <= self._max_speed * span)
        start, end = (Rotation.from_quat(self._poses[rows, 3:]) for rows in (left, right))
        turn = (start.inv() * end).as_rotvec()  # the shorter way
        return Poses(
            places[left] + share[:, None] * move,
            start * Rotation.from_rotvec(share[:, None] * turn),
            is_inside & (is_filled | is_exact),
        )

    def _sort_in(self) -> None:
        if not self._new:
            return
        stamps = np.concatenate([self._stamps, np.array([stamp for stamp, _ in self._new], dtype=np.int64)])
        new = np.array([(*pose.translation, *pose.quaternion) for _, pose in self._new], dtype=np.float64)
        order = np.argsort(stamps, kind="stable")
        is_last = np.append(np.diff(stamps[order]) > 0, True)
        kept = order[is_last][-MAX_POSES:]
        self._stamps, self._poses = stamps[kept], np.concatenate([self._poses, new])[kept]
        self._count_jumps(min(stamp for stamp, _ in self._new))
        self._new.clear()

    def _count_jumps(self, since: int) -> None:
        """Count the steps that end at a time or later, and are too fast."""
        begin = max(int(np.searchsorted(self._stamps, since)) - 1, 0)
        span = np.diff(self._stamps[begin:]) / _NANOSECONDS
        speed = np.linalg.norm(np.diff(self._poses[begin:, :3], axis=0), axis=1) / span
        is_jump = (span <= self._max_gap) & (speed > self._max_speed)
        if is_jump.any():
            self.first_jump = self.first_jump or float(speed[is_jump][0])
            self.n_jumps += int(np.count_nonzero(is_jump))
