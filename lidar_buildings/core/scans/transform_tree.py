"""The tree of frames that /tf, /tf_static and odometry tell, and whether their times are of one clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.scans.trajectory import Pose, Poses, Trajectory

#: Frames that are taken note of; wide margin: a vehicle has tens.
MAX_FRAMES = 1_000
#: A pose so much earlier than the last one of its frame says that the clock was set back [ns]; wide margin
#: over the disorder in which messages of one sender come.
SET_BACK = 1_000_000_000
#: A frame as it lies in itself.
_NO_MOVE = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
_NO_TIMES = np.empty(0, dtype=np.int64)
#: A clock that is set back so often within so many messages is none: two senders tell their own times.
_OFTEN, _MESSAGES = 3, 1_000


class TransformTree:
    """
    Frames, each in its parent; gaps and speeds are those of `Trajectory`.

    `n_refused` counts poses that were none: not finite, off the Earth, or no rotation; or of one frame too
    many.
    """

    def __init__(self, max_gap: float, max_speed: float) -> None:
        self._limits = (max_gap, max_speed)
        self._parents: dict[str, str] = {}
        self._edges: dict[str, Pose | Trajectory] = {}
        self._fixed: set[str] = set()
        self.n_refused = 0

    def set_fixed(self, parent: str, child: str, pose: Pose) -> None:
        """Fix a frame in its parent for ever, whatever messages say of it."""
        child = frame_name(child)
        self._fixed.discard(child)
        self.add_static(parent, child, pose)
        self._fixed.add(child)

    def add_static(self, parent: str, child: str, pose: Pose) -> None:
        """Take a transform of /tf_static."""
        parent, child = frame_name(parent), frame_name(child)
        if child in self._fixed or not self._is_taken(child, pose):
            return
        if self._parents.get(child) != parent and isinstance(self._edges.get(child), Trajectory):
            self._hang(parent, child, pose)
        else:
            self._parents[child], self._edges[child] = parent, pose

    def add(self, parent: str, child: str, stamp: int, pose: Pose) -> None:
        """Take a transform of /tf, or a pose of odometry."""
        parent, child = frame_name(parent), frame_name(child)
        if child in self._fixed or not self._is_taken(child, pose):
            return
        edge = self._edges.get(child)
        if not isinstance(edge, Trajectory) or self._parents[child] != parent:
            if isinstance(edge, Pose) and self._parents[child] != parent:
                self._hang(self._parents[child], child, edge)
            edge = self._edges[child] = Trajectory(*self._limits)
            self._parents[child] = parent
        edge.add(stamp, pose)

    def _hang(self, frame: str, child: str, pose: Pose) -> None:
        """Fix a frame under its child, which moves in another one: a frame has one parent."""
        if frame not in self._parents:
            self._parents[frame], self._edges[frame] = child, pose.inverted()

    def is_set_back(self, child: str, stamp: int) -> bool:
        """Whether a pose of a frame says that the clock was set back."""
        edge = self._edges.get(frame_name(child))
        return isinstance(edge, Trajectory) and edge.last is not None and stamp < edge.last - SET_BACK

    def set_back(self, stamp: int) -> None:
        """Forget what is known of the time after a stamp, where that is of before the clock was set back."""
        for child, edge in self._edges.items():
            if isinstance(edge, Trajectory) and self.is_set_back(child, stamp):
                edge.set_back(stamp)

    @property
    def jumps(self) -> tuple[int, float]:
        """How many steps of poses were faster than `max_speed`, and the speed of a first one [m/s]."""
        tracks = [edge for edge in self._edges.values() if isinstance(edge, Trajectory) and edge.n_jumps]
        return sum(one.n_jumps for one in tracks), tracks[0].first_jump if tracks else 0.0

    @property
    def frames(self) -> list[str]:
        """Names of all frames."""
        return sorted({*self._parents, *self._parents.values()})

    def root_of(self, frame: str) -> str:
        """Return the last frame on the way up."""
        return self._way_up(frame)[-1]

    def has_way(self, source: str, target: str) -> bool:
        """Whether the two frames are connected."""
        return self.root_of(source) == self.root_of(target)

    def moves(self, source: str, target: str) -> bool:
        """Whether poses by time lie on the way between two frames."""
        return any(True for _ in self._moving(source, target))

    def known_until(self, source: str, target: str) -> int | None:
        """Return up to when the moving transforms between two frames are known [ns]; None if none moves."""
        return min((edge.last or 0 for edge in self._moving(source, target)), default=None)

    def stamps(self, source: str, target: str) -> NDArray[np.int64]:
        """Return the times at which poses between two frames were told [ns]."""
        return np.concatenate([_NO_TIMES, *(edge.stamps for edge in self._moving(source, target))])

    def drop_before(self, stamp: int) -> None:
        """Forget poses that no later time needs [ns]."""
        for edge in self._edges.values():
            if isinstance(edge, Trajectory):
                edge.drop_before(stamp)

    def poses(self, source: str, target: str, times: NDArray[np.int64]) -> Poses:
        """Return the poses of frame `source` in frame `target`; KeyError if they are not connected."""
        up, down = self._way_up(source), self._way_up(target)
        common = next((frame for frame in up if frame in down), None)
        if common is None:
            raise KeyError(f"no transform leads from {source} to {target}")
        poses = self._to(source, common, times)
        return poses if common == down[0] else self._to(target, common, times).inverted().after(poses)

    def _is_taken(self, child: str, pose: Pose) -> bool:
        """Whether a pose is one, and of a frame that is known or one of not too many; counted if not."""
        is_taken = pose.is_valid and (child in self._edges or len(self._edges) < MAX_FRAMES)
        self.n_refused += not is_taken
        return is_taken

    def _to(self, frame: str, ancestor: str, times: NDArray[np.int64]) -> Poses:
        poses, frame = None, frame_name(frame)
        while frame != frame_name(ancestor):
            edge = self._edges[frame].at(times)
            poses = edge if poses is None else edge.after(poses)
            frame = self._parents[frame]
        return poses or _NO_MOVE.at(times)

    def _moving(self, source: str, target: str) -> Iterator[Trajectory]:
        for frame in set(self._way_up(source)) ^ set(self._way_up(target)):
            if isinstance(edge := self._edges.get(frame), Trajectory):
                yield edge

    def _way_up(self, frame: str) -> list[str]:
        """Return a frame and its ancestors; a loop, which no tree has, ends the way."""
        way = [frame_name(frame)]
        while (parent := self._parents.get(way[-1])) is not None and parent not in way:
            way.append(parent)
        return way


def frame_name(name: Any) -> str:
    """Return a frame's name as ROS 2 writes it, without the slash of ROS 1."""
    return str(name).lstrip("/")


def why_no_way(frame: str, tree: TransformTree) -> str:
    """Say what a tree lacks so that scans of a frame can be placed, and what can be done."""
    known = ", ".join(tree.frames) or "none"
    return (
        f"no pose leads from the scans' frame {frame!r} to one in which it moves (frames with poses: "
        f"{known}): give the odometry or /tf of it; or a static transform from scan_assembler.map_frame, if "
        "it stood still; or scan_assembler.mounting, if fixed to one of those; or "
        "scan_assembler.georeferenced=true (--georeferenced), if the scans are in the map already"
    )


class ClockWatch:
    """Tells clocks that are set back from two clocks whose messages alternate."""

    def __init__(self) -> None:
        self._n = 0
        self._set_back: deque[int] = deque(maxlen=_OFTEN)
        self._later_came = 0

    def is_of_another(self, *, is_earlier: bool) -> bool:
        """
        Whether a message is of a second clock: the earlier one, as long as messages of the later one come.

        If there is one clock, a time so much earlier than the last says that it was set back.
        """
        self._n += 1
        if not is_earlier:
            self._later_came = self._n
            return False
        if self._n - self._later_came > _MESSAGES:
            self._set_back.clear()
        elif len(self._set_back) == _OFTEN and self._set_back[-1] - self._set_back[0] <= _MESSAGES:
            return True
        self._set_back.append(self._n)
        return False
