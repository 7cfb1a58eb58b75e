"""Playing at the pace of time: what comes is made ready ahead, and told when its time has come."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

Item = TypeVar("Item")
_END = object()
_SECOND = 1e-9


@dataclass
class PlayReport:
    """How a survey was played."""

    #: What was told.
    n_scans: int = 0
    n_points: int = 0
    #: Wall time with and without scans [s].
    busy: float = 0.0
    pauses: float = 0.0
    worst_delay: float = 0.0  #: by how much at most something came too late [s]

    @property
    def rate(self) -> float:
        """Points a second while there were scans."""
        return self.n_points / max(self.busy, 1e-9)

    def __str__(self) -> str:
        return (
            f"{self.n_points:,} points in {self.n_scans:,} scans"
            f" in {self.busy:.1f} s ({self.rate:,.0f} points/s)"
            f" and {self.pauses:.1f} s between; at worst {self.worst_delay * 1000:.0f} ms late"
        )


def ahead(items: Iterable[Item], depth: int) -> Generator[Item, None, None]:
    """
    Yield items that a thread of their own makes, at most `depth` of them ahead.

    What goes wrong in making them is raised here; the thread ends when the iterator is closed.
    """
    ready: queue.Queue[Any] = queue.Queue(depth)
    is_over = threading.Event()

    def offer(item: object) -> None:
        while not is_over.is_set():
            try:
                ready.put(item, timeout=0.1)
                return
            except queue.Full:
                continue

    def work() -> None:
        try:
            for item in items:
                offer(item)
                if is_over.is_set():
                    return
            offer(_END)
        except BaseException as error:
            offer(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        while (item := ready.get()) is not _END:
            if isinstance(item, BaseException):
                raise item
            yield item
    finally:
        is_over.set()
        thread.join()


class Pace:
    """
    Waits until the time of what is told has come: as long after the first of all as it was recorded.

    The report gets the times. A time longer than `pause` between two items is one between two legs [s].
    """

    def __init__(
        self,
        report: PlayReport,
        pause: float,
        now: Callable[[], float] = time.monotonic,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        self._report = report
        self._pause, self._now, self._wait = pause, now, wait
        self._first: tuple[int, float] | None = None
        self._last = 0

    def wait_for(self, stamp: int) -> None:
        """Return when the time of something has come, at once if it has gone by [ns]."""
        now = self._now()
        if self._first is None:
            self._first, self._last = (stamp, now), stamp
        due = self._first[1] + (stamp - self._first[0]) * _SECOND
        if due > now:
            self._wait(due - now)
        step = (stamp - self._last) * _SECOND
        self._last = stamp
        if step > self._pause:
            self._report.pauses += step
        self._report.worst_delay = max(self._report.worst_delay, self._now() - due)
        self._report.busy = self._now() - self._first[1] - self._report.pauses
