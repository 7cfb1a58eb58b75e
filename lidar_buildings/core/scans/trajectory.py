"""Where a frame was in its parent, at any time between its poses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

_NANOSECONDS = 1e9


class Poses(NamedTuple):
    """
    Poses of one frame in another, one per time.

    Attributes
    ----------
    translation : ndarray of shape (n, 3)
        Position of the frame's origin [m].
    rotation : Rotation
        n rotations from the frame into the other one.
    is_known : ndarray of bool, shape (n,)
        Whether there is a pose at that time.
    """

    translation: NDArray[np.float64]
    rotation: Rotation
    is_known: NDArray[np.bool_]

    def after(self, first: Poses) -> Poses:
        """Return the poses of `first`'s frame in the frame that these lead to."""
        return Poses(
            self.translation + self.rotation.apply(first.translation),
            self.rotation * first.rotation,
            self.is_known & first.is_known,
        )

    def inverted(self) -> Poses:
        """Return the poses the other way round."""
        back = self.rotation.inv()
        return Poses(-back.apply(self.translation), back, self.is_known)

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn points of the frame, one per pose, into the other frame."""
        return self.rotation.apply(points) + self.translation


class Pose(NamedTuple):
    """One pose that holds for ever: position [m] and quaternion (x, y, z, w)."""

    translation: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]

    def at(self, times: NDArray[np.int64]) -> Poses:
        """Return the pose for each time."""
        n = len(times)
        rotation = Rotation.from_quat(np.tile(self.quaternion, (n, 1)))
        return Poses(np.tile(self.translation, (n, 1)), rotation, np.ones(n, dtype=np.bool_))


class Trajectory:
    """
    Poses by time, and what lies between them: positions on lines, attitudes by slerp (Shoemake 1985).

    Parameters
    ----------
    max_gap : float
        Longest time between two poses that is filled [s].
    max_speed : float
        Two poses further apart than this allows are of two tracks, and nothing lies between them [m/s].
    """

    def __init__(self, max_gap: float, max_speed: float) -> None:
        self._max_gap = max_gap
        self._max_speed = max_speed
        self._poses: dict[int, Pose] = {}
        self._sorted: tuple[NDArray[np.int64], NDArray[np.float64], Rotation] | None = None
        self.n_refused = 0

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self._poses)

    @property
    def last(self) -> int | None:
        """Time of the last pose [ns]."""
        return max(self._poses, default=None)

    def add(self, stamp: int, pose: Pose) -> None:
        """Add a pose; a later one of the same time replaces it, one that is none is counted and left out."""
        numbers = np.array([*pose.translation, *pose.quaternion])
        if not np.isfinite(numbers).all() or not np.abs(numbers[3:]).max() > 0:
            self.n_refused += 1
            return
        self._poses[stamp] = pose
        self._sorted = None

    def drop_before(self, stamp: int) -> None:
        """Forget poses that no later time needs: all but the last one before a time."""
        past = sorted(one for one in self._poses if one <= stamp)[:-1]
        for one in past:
            del self._poses[one]
        if past:
            self._sorted = None

    def at(self, times: NDArray[np.int64]) -> Poses:
        """
        Return the pose at each time.

        Parameters
        ----------
        times : ndarray of int64, shape (n,)
            [ns].
        """
        if not self._poses:
            return (
                Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
                .at(times)
                ._replace(is_known=np.zeros(len(times), dtype=np.bool_))
            )
        stamps, places, attitudes = self._table()
        if len(stamps) == 1:
            only = next(iter(self._poses.values())).at(times)
            return only._replace(is_known=times == stamps[0])
        right = np.clip(np.searchsorted(stamps, times), 1, len(stamps) - 1)
        left = right - 1
        span = (stamps[right] - stamps[left]) / _NANOSECONDS
        is_inside = (times >= stamps[0]) & (times <= stamps[-1])
        length = np.linalg.norm(places[right] - places[left], axis=1)
        is_exact = (times == stamps[left]) | (times == stamps[right])
        is_filled = (span <= self._max_gap) & (length <= self._max_speed * span)
        share = np.clip((times - stamps[left]) / (stamps[right] - stamps[left]), 0.0, 1.0)[:, None]
        between = places[left] + share * (places[right] - places[left])
        since = np.clip(times, stamps[0], stamps[-1]) - stamps[0]
        rotation = Slerp((stamps - stamps[0]).astype(np.float64), attitudes)(since.astype(np.float64))
        return Poses(between, rotation, is_inside & (is_filled | is_exact))

    def _table(self) -> tuple[NDArray[np.int64], NDArray[np.float64], Rotation]:
        if self._sorted is None:
            stamps = sorted(self._poses)
            poses = [self._poses[stamp] for stamp in stamps]
            self._sorted = (
                np.array(stamps, dtype=np.int64),
                np.array([pose.translation for pose in poses], dtype=np.float64),
                Rotation.from_quat(np.array([pose.quaternion for pose in poses], dtype=np.float64)),
            )
        return self._sorted
