"""Scans that wait for the poses of their points."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from operator import itemgetter

from lidar_buildings.core.scans.scan import Scan, is_alike, joined

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
