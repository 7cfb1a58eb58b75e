"""The tree of frames that /tf, /tf_static and odometry tell, and whether their times are of one clock."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.scans.trajectory import Loss, Pose, Poses, Trajectory

#: Frames that are taken note of; wide margin: a vehicle has tens.
MAX_FRAMES = 1_000
#: A pose so much earlier than the last one of its frame says that the clock was set back [ns]; wide margin
#: over the disorder in which messages of one sender come.
SET_BACK = 1_000_000_000
#: A frame as it lies in itself.
_NO_MOVE = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
_NO_TIMES = np.empty(0, dtype=np.int64)
#: Parents of a frame that are taken note of beside the one that is taken.
_MOST_PARENTS = 3
_TWO_PARENTS = (
    "frame {!r} has two parents, {!r} and {!r}: poses in {!r} are taken, which {}; stop the other sender"
)
#: A clock that is set back so often within so many messages is none: two senders tell their own times.
_OFTEN, _MESSAGES = 3, 1_000


class TransformTree:
    """
    Frames, each in its parent; gaps and speeds are those of `Trajectory`.

    Of a frame with two parents the one is taken whose poses lead to the frame `wanted`, are better in a tree
    that is `known` and settled, or go on; what is fixed in two frames ties these together. `n_refused` counts
    poses that were none: not finite, off the Earth, or no rotation; or of one frame too many.
    """

    def __init__(
        self, max_gap: float, max_speed: float, wanted: str = "", known: TransformTree | None = None
    ) -> None:
        self._limits = (max_gap, max_speed)
        self._wanted, self._known = frame_name(wanted), known
        #: What other parents than the one that is taken say of frames that move.
        self._others: dict[str, dict[str, Trajectory]] = {}
        self._doubled: dict[str, str] = {}
        self._settled: dict[str, str] = {}
        self._parents: dict[str, str] = {}
        self._edges: dict[str, Pose | Trajectory] = {}
        self._fixed: set[str] = set()
        self._rough: dict[str, str] = {}
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
        edge, other = self._edges.get(child), self._parents.get(child)
        if other == parent or edge is None:
            self._parents[child], self._edges[child] = parent, pose
        elif isinstance(edge, Trajectory) or parent not in self._parents:
            self._hang(parent, child, pose)
        elif other not in self._parents:  # what it is fixed in is fixed in nothing
            self._parents[child], self._edges[child] = parent, pose
            self._hang(str(other), child, edge)
        else:
            self._doubled[child] = _TWO_PARENTS.format(child, other, parent, other, "came first")

    def add(self, parent: str, child: str, stamp: int, pose: Pose) -> None:
        """Take a transform of /tf, or a pose of odometry."""
        parent, child = frame_name(parent), frame_name(child)
        if child in self._fixed or not self._is_taken(child, pose):
            return
        edge, other = self._edges.get(child), self._parents.get(child)
        if not isinstance(edge, Trajectory):
            if isinstance(edge, Pose) and other != parent:
                self._hang(str(other), child, edge)
            self._parents[child] = parent
            edge = self._edges[child] = Trajectory(*self._limits)
        if self._parents[child] == parent:
            edge.add(stamp, pose)
            return
        others = self._others.setdefault(child, {})
        if parent not in others and len(others) >= _MOST_PARENTS:
            self.n_refused += 1
            return
        others.setdefault(parent, Trajectory(*self._limits)).add(stamp, pose)
        self._choose(child, parent)

    def _choose(self, child: str, other: str) -> None:
        """Take the other parent of a frame if it is better."""
        own, rival = self._parents[child], self._others[child][other]
        edge = cast(Trajectory, self._edges[child])
        known = "" if self._known is None else self._known._settled.get(child, "")
        leads = {one: self._way_up(one)[-1] == self._wanted for one in (own, other)}
        has_ended = (edge.last or 0) + round(rival.filled * 1e9) < (rival.last or 0)
        if known in leads:
            best, why = known, "are better over the whole bag"
        elif leads[own] != leads[other]:
            best, why = (own if leads[own] else other), f"lead to {self._wanted!r}"
        else:
            best, why = (other, "go on") if has_ended else (own, "came first")
        if best == other:
            self._exchange(child, other)
        if not has_ended:
            self._doubled[child] = _TWO_PARENTS.format(child, *sorted((own, other)), best, why)

    def _exchange(self, child: str, other: str) -> None:
        """Take the other parent of a frame."""
        own, edge = self._parents[child], cast(Trajectory, self._edges[child])
        self._parents[child], self._edges[child] = other, self._others[child].pop(other)
        self._others[child][own] = edge

    def settle(self) -> None:
        """Take the better one of several parents, now that all poses have come."""
        for child, others in self._others.items():
            both = {self._parents[child]: cast(Trajectory, self._edges[child]), **others}
            spans = [one.span for one in both.values()]
            if max(begin for begin, _ in spans) >= min(end for _, end in spans):
                continue  # one after the other
            best = max(
                (self._way_up(one)[-1] == self._wanted, track.covered, len(track), one)
                for one, track in both.items()
            )[-1]
            self._settled[child] = best
            if best in others:
                self._exchange(child, best)

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
                for one in (edge, *self._others.get(child, {}).values()):
                    one.set_back(stamp)

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

    def is_young(self, source: str, target: str) -> bool:
        """Whether the next pose of a link between two frames may tell that it comes as seldom as that."""
        return any(edge.is_young for edge in self._moving(source, target))

    def losses(self, source: str, target: str, times: NDArray[np.int64]) -> dict[tuple[str, str], Loss]:
        """Return for each link on a way, (child, parent), at which times it has no pose, and why."""
        way = set(self._way_up(source)) ^ set(self._way_up(target))
        return {
            (child, self._parents[child]): edge.loss(times)
            for child in sorted(way)
            if isinstance(edge := self._edges.get(child), Trajectory)
        }

    def usual_step(self, child: str) -> tuple[float, float]:
        """Return how often poses of a frame come, and how long gaps are filled [s]; zeros if it is fixed."""
        edge = self._edges.get(child)
        return (edge.usual_step, edge.filled) if isinstance(edge, Trajectory) else (0.0, 0.0)

    @property
    def doubts(self) -> list[str]:
        """Say of frames that move how their poses contradict one another, each once."""
        for child, edge in self._edges.items():
            if isinstance(edge, Trajectory) and child not in self._rough and (rough := edge.roughness):
                self._rough[child] = (
                    f"poses of {child!r} in {self._parents[child]!r}, every {edge.usual_step:.2g} s, are "
                    f"{rough[0]:.2f} m and {math.degrees(rough[1]):.2f}° off what lies between their "
                    "neighbours: they come too seldom, or from two senders"
                )
        return [*self._doubled.values(), *self._rough.values()]

    def drop_before(self, stamp: int) -> None:
        """Forget poses that no later time needs [ns]."""
        others = (one for per in self._others.values() for one in per.values())
        for edge in (*self._edges.values(), *others):
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


#: From UTC to the time of GPS and of atoms, since 2017 [s]; scans and poses come with such a delay at most.
WHOLE_CLOCKS, _DELAY = (18, 37), 1.5
#: So many scans over so long settle which clock theirs is; it is another one as long as it stays ahead so
#: evenly, in parts of that time.
_N_LAGS, _LAG_PERIOD, _EVENLY = 5, 1.0, 0.5


class ScanClock:
    """Finds out whether scans' stamps are whole seconds ahead of the poses', as GPS and TAI are of UTC."""

    def __init__(self) -> None:
        self._lags: list[tuple[float, float]] = []
        self.ahead = 0  #: seconds that they are ahead
        self.is_settled = False

    def note(self, stamp: int, last_pose: int) -> None:
        """Note the stamp of a scan, and of the last pose that came before it [ns]."""
        if self.is_settled:
            return
        self._lags.append((stamp / 1e9, (stamp - last_pose) / 1e9))
        stamps, lags = np.array(self._lags).T
        if len(lags) >= _N_LAGS and np.ptp(stamps) >= _LAG_PERIOD:
            is_even = np.ptp(lags) < _EVENLY * np.ptp(stamps)
            self.ahead = _near_clock(float(np.median(lags))) if is_even else 0
            self.is_settled = True

    @property
    def is_doubtful(self) -> bool:
        """Whether more scans may tell that they are ahead."""
        return not self.is_settled and bool(self._lags) and _near_clock(self._lags[-1][1]) != 0


def _near_clock(lag: float) -> int:
    """Return the difference of clocks that is near a lag [s], 0 if none is."""
    return next(
        (sign * one for one in WHOLE_CLOCKS for sign in (1, -1) if abs(lag - sign * one) <= _DELAY), 0
    )
