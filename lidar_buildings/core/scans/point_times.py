"""When each point of a scan was measured, as drivers tell it: decided once for all scans of a topic."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.errors import MessageError

#: Names that drivers give to the time of a point: Velodyne and Hesai (`time`, `timestamp`), Ouster (`t`),
#: Livox (`offset_time`, `timestamp`), RoboSense (`timestamp`); the first that is there counts.
TIME_FIELDS = ("t", "time", "timestamp", "offset_time", "time_offset", "timeOffset", "time_stamp")
#: Seconds per unit.
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
#: A time this near to the scan's stamp is a time of day, not one since the scan's beginning [s]: what tells
#: them apart where there is but one scan.
_NEAR = 86_400.0
#: The longest that a scan or packet lasts [s].
LONGEST = 2.0
#: Scans by which it is decided what times are, or those of so long [s] if there are at least two; and those
#: that must contradict it in a row.
N_SCANS, _PERIOD, _N_ANEW = 3, 1.0, 5
#: Times are of a clock that runs with the stamps if so many of their steps are as long as those of stamps,
#: and scans no longer than so many of them.
_MOST, _RUNNING, _MOST_STEPS = 0.75, (0.5, 1.5), 10.0
#: Points belong to a scan if they are no further from its middle than so many times what scans last.
_REACH = 1.5
#: Clocks that differ by whole seconds, as GPS and TAI do from UTC, differ by these if by nearly as much [s].
_WHOLE = 0.3
#: Steps of single precision that are no times any more [s].
_COARSE = 0.005
#: Scans are not told apart in time if their stamps are nearer than this [s].
_AT_ONCE = 1e-4
_NANOSECONDS = 1e9
#: What is to be said of times, in words.
COARSE_TIMES = "scans whose points have times since 1970 as float32, minutes apart: taken for none"
OTHER_CLOCK = "scans whose points' clock is {:+,.3f} s off that of their stamps: set by these"


class ScanTimes(NamedTuple):
    """Times of a scan's points, as its message holds them."""

    values: NDArray[Any]  #: finite, shape (n,)
    stamp: int  #: of the message [ns]


class TimeReading(NamedTuple):
    """
    What the numbers of a topic's field of times mean.

    They count from the scan's stamp, or from `epoch` [ns] where that is given. `middle` is where the middle
    of a scan lies after its stamp, and points that are further from it than `reach` [s] have a wrong time.
    """

    seconds: float  #: length of the unit [s]; 0: they say nothing
    epoch: int | None = None
    middle: float = 0.0
    reach: float = LONGEST
    doubt: str = ""  #: what is to be said of it

    def times(self, scan: ScanTimes) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the time of each point [ns], and which are those of the scan, shape (n,)."""
        if not self.seconds or not len(scan.values):
            return np.full(len(scan.values), scan.stamp, np.int64), np.ones(len(scan.values), np.bool_)
        begin = 0.0 if self.epoch is None else (scan.stamp - self.epoch) / _NANOSECONDS
        after = scan.values.astype(np.float64) * self.seconds - begin
        # stamps of the moment when a message was sent are late by turns: what is clear is which points agree
        middle = self.middle if self.epoch is None else _near(float(np.median(after)), self.middle)
        is_own = np.abs(after - middle) <= self.reach
        own = np.where(is_own, scan.values, 0)
        if own.dtype.kind in "iu":
            since = own.astype(np.int64) * round(self.seconds * _NANOSECONDS)
        else:  # seconds since 1970 keep a quarter of a microsecond
            since = np.rint(own.astype(np.float64) * (self.seconds * _NANOSECONDS)).astype(np.int64)
        return since + (scan.stamp if self.epoch is None else self.epoch), is_own


def read_times(field: str, scans: list[ScanTimes], unit: str = "auto") -> TimeReading:
    """
    Find out what a field of times means, by medians over some scans of a topic, one at least.

    Numbers that grow as the scans' stamps do are of a clock, in the unit that makes them grow so; others
    count from the stamp, in the unit in which scans last about as long as from one to the next, and no longer
    than 2 s. Of a single scan, times within a day of its stamp are of a clock, else the coarsest unit counts,
    and nanoseconds of whole numbers. A `unit` of `UNITS` that is named counts in any case. MessageError if no
    unit fits.

    >>> scans = [ScanTimes(np.linspace(0.0, 100.0, 50), k * 100_000_000) for k in range(5)]
    >>> read_times("time", scans).seconds
    0.001
    """
    scans = [one for one in scans if len(one.values) and one.values.any()]
    if not scans:
        return TimeReading(0.0)
    quarters = np.array([np.quantile(one.values.astype(np.float64), (0.25, 0.5, 0.75)) for one in scans])
    stamps = np.array([one.stamp for one in scans])
    steps = np.abs(np.diff(stamps)) / _NANOSECONDS
    steps = np.sort(steps[steps > _AT_ONCE])
    between = float(steps[(len(steps) - 1) // 2]) if len(steps) else 0.0
    middles, length = quarters[:, 1], 2.0 * float(np.median(quarters[:, 2] - quarters[:, 0]))
    units = {unit: UNITS[unit]} if unit in UNITS else UNITS
    for seconds in units.values():
        is_short = not between or length * seconds <= _MOST_STEPS * between
        if is_short and _are_of_a_clock(middles * seconds, stamps):
            return _of_a_clock(scans, seconds, max(between, length * seconds))
    middle = float(np.median(middles))
    fitting = {
        seconds: _misfit(length * seconds, between)
        for seconds in units.values()
        if abs(middle) * seconds <= LONGEST and length * seconds <= 2.0 * LONGEST
    }
    if not fitting:
        raise MessageError(f"field {field} holds times of about {middle:g}: no unit makes them a scan's")
    seconds = min(fitting, key=lambda one: (fitting[one], -one))
    if not between and scans[0].values.dtype.kind in "iu" and UNITS["ns"] in fitting:
        seconds = UNITS["ns"]
    longest = max(between, length * seconds) if between else LONGEST
    return TimeReading(seconds, None, middle * seconds, min(_REACH * longest, LONGEST))


def _are_of_a_clock(middles: NDArray[np.float64], stamps: NDArray[np.int64]) -> bool:
    """Whether times [s] of scans run with their stamps [ns]; of a single scan, whether they are near it."""
    steps = np.diff(stamps) / _NANOSECONDS
    is_step = np.abs(steps) > _AT_ONCE
    if not is_step.any():
        middle = float(np.median(middles))
        return middle > LONGEST and abs(middle - float(stamps[0]) / _NANOSECONDS) < _NEAR
    runs = np.diff(middles)[is_step] / steps[is_step]
    return bool(np.mean((runs > _RUNNING[0]) & (runs < _RUNNING[1])) >= _MOST)


def _of_a_clock(scans: list[ScanTimes], seconds: float, longest: float) -> TimeReading:
    """Return the reading of times of a clock: that of the stamps, or another one, which is set by them."""
    values = scans[0].values
    if values.dtype.kind == "f" and float(np.spacing(np.abs(np.median(values)))) * seconds > _COARSE:
        return TimeReading(0.0, doubt=COARSE_TIMES)
    begin, middle = np.median(
        [
            np.quantile(one.values.astype(np.float64), (0.05, 0.5)) * seconds - one.stamp / _NANOSECONDS
            for one in scans
        ],
        axis=0,
    ).tolist()
    reach = min(_REACH * longest, LONGEST) if longest else LONGEST
    if abs(middle) <= LONGEST:
        return TimeReading(seconds, 0, middle, reach)
    ahead = round(middle) if abs(middle - round(middle)) <= _WHOLE else begin
    doubt = OTHER_CLOCK.format(ahead)
    return TimeReading(seconds, -round(ahead * _NANOSECONDS), middle - ahead, reach, doubt)


def _misfit(length: float, between: float) -> float:
    """Return how badly a scan's length fits the time between scans [s]: longer ones would overlap."""
    if not between or not length:
        return 0.0
    excess = math.log10(length / between / _REACH)
    return 2.0 * excess if excess > 0.0 else max(-math.log10(length / between), 0.0)


def _near(found: float, usual: float) -> float:
    """Return the middle of a scan, or the usual one if it is none of a scan's."""
    return found if abs(found - usual) <= LONGEST else usual


class TimedScan(NamedTuple):
    """A scan, and when its points were measured."""

    scan: Any
    times: NDArray[np.int64]  #: [ns], shape (n,)
    is_own: NDArray[np.bool_]  #: which of them are those of the scan, shape (n,)
    doubt: str  #: what is to be said of them


class TopicTimes:
    """
    Decides what times of a topic's scans mean, and gives them.

    Scans wait until so many have come that it is decided. Afterwards those in which most points have a wrong
    time wait, too: if as many come in a row, it is decided anew.
    """

    def __init__(self, field: str, unit: str) -> None:
        self._field, self._unit = field, unit
        self._reading: TimeReading | None = None
        self.waiting: list[tuple[Any, ScanTimes]] = []

    def take(self, scan: Any, times: ScanTimes) -> list[TimedScan]:
        """Take a scan; return those whose times are known now. MessageError if no unit fits what waits."""
        if self._reading is not None:
            timed = TimedScan(scan, *self._reading.times(times), self._reading.doubt)
            if 2 * np.count_nonzero(timed.is_own) >= len(times.values):
                return [*self._all(self._reading), timed]
        self.waiting.append((scan, times))
        stamps = [one.stamp for _, one in self.waiting]
        is_long = len(stamps) > 1 and max(stamps) - min(stamps) >= _PERIOD * _NANOSECONDS
        if len(stamps) < _N_ANEW if self._reading is not None else not is_long and len(stamps) < N_SCANS:
            return []
        self._reading = None
        return self.rest()

    def rest(self) -> list[TimedScan]:
        """Return what waits. MessageError if no unit fits it."""
        if self._reading is None and self.waiting:
            self._reading = read_times(self._field, [times for _, times in self.waiting], self._unit)
        return self._all(self._reading) if self._reading is not None else []

    def _all(self, reading: TimeReading) -> list[TimedScan]:
        waiting, self.waiting = self.waiting, []
        return [TimedScan(scan, *reading.times(times), reading.doubt) for scan, times in waiting]
