"""Playing at the pace of time."""

import itertools
import threading
from contextlib import closing

import pytest

from lidar_buildings.simulation.live.messages import Pace, PlayReport, ahead


class Clock:
    """A clock that only waiting and work move on."""

    def __init__(self):
        self.time = 100.0

    def now(self):
        return self.time

    def wait(self, seconds):
        self.time += seconds


def played(stamps, works, pause=0.5):
    """When each item is told, and the report [s]."""
    clock, told, report = Clock(), [], PlayReport()
    pace = Pace(report, pause, clock.now, clock.wait)
    for stamp, work in zip(stamps, works, strict=True):
        pace.wait_for(round(stamp * 1e9))
        told.append(clock.time - 100.0)
        clock.time += work
    return told, report


def test_each_item_is_told_when_its_time_has_come_and_what_is_late_at_once():
    told, report = played([7.0, 7.1, 7.3], [0.0, 0.05, 0.0])
    assert told == pytest.approx([0.0, 0.1, 0.3])
    assert report.worst_delay == pytest.approx(0.0, abs=1e-9)
    told, report = played([0.0, 0.1, 0.2, 0.9], [0.35, 0.0, 0.0, 0.0])
    assert told == pytest.approx([0.0, 0.35, 0.35, 0.9])
    assert report.worst_delay == pytest.approx(0.25)


def test_the_rate_counts_no_time_between_legs():
    _, report = played([0.0, 0.4, 5.4, 5.8], [0.0] * 4)
    report.n_points = 80
    assert (report.busy, report.pauses) == pytest.approx((0.8, 5.0))
    assert report.rate == pytest.approx(100.0)
    assert "80 points" in str(report)


def test_items_come_in_order_and_not_too_many_of_them_ahead():
    made = []

    def making():
        for number in range(20):
            made.append(number)
            yield number

    seen = []
    for number in ahead(making(), 3):
        assert len(made) <= number + 3 + 2  # in the queue, and one on either side of it
        seen.append(number)
    assert seen == list(range(20))


def test_an_error_in_making_is_raised_where_the_items_are_read_and_the_thread_ends_with_the_reader():
    def making():
        yield 1
        raise OSError("full")

    items = ahead(making(), 2)
    assert next(items) == 1
    with pytest.raises(OSError, match="full"):
        next(items)
    before = threading.active_count()
    with closing(ahead(itertools.count(), 2)) as items:
        assert next(items) == 0
    assert threading.active_count() == before
