"""Where a frame was in its parent, at any time between its poses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_NANOSECONDS = 1e9
#: Nothing on or near the Earth has a greater coordinate in any reference system [m].
MAX_COORDINATE = 1e8
#: Poses that are kept of a frame: a quarter of an hour at 200 Hz, where nothing else forgets them.
MAX_POSES = 200_000
#: How far a quaternion's length may be from 1; wide margin over single precision.
_MAX_NORM_ERROR = 0.1
#: New poses are sorted in at the latest when they are so many.
_BATCH = 10_000


class Poses(NamedTuple):
    """Poses of one frame in another, one per time."""

    translation: NDArray[np.float64]  #: position of the frame's origin [m], shape (n, 3)
    #: x, y, z, w of the rotations from the frame into the other one, shape (n, 4).
    quaternion: NDArray[np.float64]
    is_known: NDArray[np.bool_]  #: whether there is a pose at that time, shape (n,)

    def after(self, first: Poses) -> Poses:
        """Return the poses of `first`'s frame in the frame that these lead to."""
        return Poses(
            self.apply(first.translation),
            product(self.quaternion, first.quaternion),
            self.is_known & first.is_known,
        )

    def inverted(self) -> Poses:
        """Return the poses the other way round."""
        back = conjugate(self.quaternion)
        return Poses(-rotated(back, self.translation), back, self.is_known)

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn points of the frame, one per pose, into the other frame."""
        return rotated(self.quaternion, points) + self.translation


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
        return Pose(tuple(back.translation[0].tolist()), tuple(back.quaternion[0].tolist()))

    def at(self, times: NDArray[np.int64]) -> Poses:
        """Return the pose for each time."""
        n = len(times)
        quaternion = np.array(self.quaternion) / math.hypot(*self.quaternion)
        return Poses(
            np.tile(self.translation, (n, 1)), np.tile(quaternion, (n, 1)), np.ones(n, dtype=np.bool_)
        )


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
        """Return the number of poses."""
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
        return Poses(
            places[left] + share[:, None] * move,
            self._attitudes(left, share),
            is_inside & (is_filled | is_exact),
        )

    def _attitudes(self, left: NDArray[np.intp], share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return attitudes at shares of the ways from poses to the next ones."""
        start = self._poses[left, 3:]
        turn = product(conjugate(start), self._poses[np.minimum(left + 1, len(self._poses) - 1), 3:])
        turn *= np.where(turn[:, 3:] < 0, -1.0, 1.0)  # the shorter way
        sine = np.linalg.norm(turn[:, :3], axis=1)
        half = share * np.arctan2(sine, turn[:, 3])
        scale = np.divide(np.sin(half), sine, out=np.zeros(len(left)), where=sine > 0)
        return product(start, np.column_stack([scale[:, None] * turn[:, :3], np.cos(half)]))

    def _sort_in(self) -> None:
        """Put the new poses where they belong."""
        if not self._new:
            return
        stamps = np.concatenate([self._stamps, np.array([stamp for stamp, _ in self._new], dtype=np.int64)])
        new = np.array([(*pose.translation, *pose.quaternion) for _, pose in self._new], dtype=np.float64)
        new[:, 3:] /= np.linalg.norm(new[:, 3:], axis=1, keepdims=True)
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


def product(second: NDArray[np.float64], first: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotations that do `first` and then `second`."""
    (ax, ay, az, aw), (bx, by, bz, bw) = second.T, first.T
    return np.column_stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )


def conjugate(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotations back."""
    return quaternion * np.array([-1.0, -1.0, -1.0, 1.0])


def rotated(quaternion: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points, shape (n, 3), each turned by its rotation."""
    (qx, qy, qz, qw), (x, y, z) = quaternion.T, points.T
    # v + 2 w (q × v) + 2 q × (q × v)
    tx, ty, tz = 2 * (qy * z - qz * y), 2 * (qz * x - qx * z), 2 * (qx * y - qy * x)
    return np.column_stack(
        [
            x + qw * tx + qy * tz - qz * ty,
            y + qw * ty + qz * tx - qx * tz,
            z + qw * tz + qx * ty - qy * tx,
        ]
    )
