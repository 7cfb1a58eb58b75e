"""Which frames and fields of times are those of a topic's scans: decided by most of them, not one by one."""

from __future__ import annotations

from collections import Counter, deque
from typing import NamedTuple

from lidar_buildings.core.scans.scan import Scan

#: Scans by which it is decided first, and those that are looked back at; a scan waits for so many others.
_N_FIRST, _N_LAST = 3, 50
#: From so many scans on a form is usual if the most frequent one is so many times as frequent at most:
#: scanners of 2 and 10 Hz may share a topic. Among few scans it is less.
_FEW = 5
_MOST = {20: 5.0, _FEW: 3.0, 0: 1.9}


class Form(NamedTuple):
    """What a topic's scans have in common."""

    frame: str
    time_field: str  #: empty if none tells times
    time_type: str  #: as numpy calls it

    @classmethod
    def of(cls, scan: Scan) -> Form:
        """Return the form of a scan."""
        return cls(scan.frame, scan.time_field, "" if scan.told is None else scan.told.values.dtype.str)

    def __str__(self) -> str:
        """Say it in words."""
        times = f"times in {self.time_field!r}" if self.time_field else "no times"
        return f"of frame {self.frame!r} with {times}"


class TopicForms:
    """Gives scans of usual forms, in the order in which they came; what is not usual waits to become so."""

    def __init__(self) -> None:
        self._last: deque[Form] = deque(maxlen=_N_LAST)
        self._n_came = 0
        self._waiting: list[tuple[int, Scan]] = []

    @property
    def n_waiting(self) -> int:
        """Points of scans that wait."""
        return sum(len(scan.times) for _, scan in self._waiting)

    def take(self, scan: Scan) -> list[Scan]:
        """Take a scan; return those that are known now to be of the topic."""
        self._last.append(Form.of(scan))
        self._waiting.append((self._n_came, scan))
        self._n_came += 1
        return self._usual() if self._n_came >= _N_FIRST else []

    def rest(self) -> list[Scan]:
        """Return what waits and is of the topic, when nothing more is waited for; of a few scans all."""
        if self._n_came >= _FEW:
            return self._usual()
        rest, self._waiting = [scan for _, scan in self._waiting], []
        return rest

    def refused(self, *, is_end: bool = False) -> list[Scan]:
        """Return what is not of the topic: what has waited too long, at the end all that waits."""
        first = self._n_came if is_end else self._n_came - _N_LAST
        refused = [scan for number, scan in self._waiting if number < first]
        self._waiting = [one for one in self._waiting if one[0] >= first]
        return refused

    def _usual(self) -> list[Scan]:
        counts = Counter(self._last)
        times = next(times for least, times in _MOST.items() if len(self._last) >= least)
        is_usual = [counts[Form.of(scan)] * times >= max(counts.values()) for _, scan in self._waiting]
        waiting = list(zip(self._waiting, is_usual, strict=True))
        self._waiting = [one for one, usual in waiting if not usual]
        return [scan for (_, scan), usual in waiting if usual]
