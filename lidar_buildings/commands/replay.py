"""A bag as a feed: its scans and poses reach the assembler when they did as it was recorded."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.bags.bag import CLOUD, FIX, POINT, VECTOR, BagMessage, open_bag
from lidar_buildings.io.bags.bag_inputs import NO_SCAN, BagConfig
from lidar_buildings.io.bags.bag_summary import choose_topics, chosen_messages, told_frame
from lidar_buildings.io.bags.placed_cloud import hand_over
from lidar_buildings.io.tiling.live_feed import LiveFeed
from lidar_buildings.simulation.live.messages import Pace, PlayReport, ahead

#: Messages that are read ahead: half a second of 200 poses and 20 scans.
_AHEAD = 100
#: Share of the room for what waits that a bag fills at most, and how often it is looked [s].
_MOST_WAITING, _TICK = 0.1, 0.01
#: A longer time between two messages is a pause [s].
_PAUSE = 1.0


class Replay:
    """
    Gives a feed the messages of a bag, from a thread of its own; none is lost, however slow the feed is.

    Of an MCAP file that was cut off what is whole; `problem` says why only a part is played, and which. The
    rate is a multiple of the recorded time, 0 = as fast as the feed takes it. InputError if the bag cannot be
    read, or it is not clear which topics are meant.
    """

    def __init__(self, path: Path, choice: BagConfig, rate: float) -> None:
        self._bag, self.problem = open_bag(path)
        self._topics = choose_topics(self._bag, choice.topic, choice.odometry)
        self._choice, self._rate, self._report = choice, rate, PlayReport()
        self._error: Exception | None = None
        self._is_over, self._is_stopping = threading.Event(), threading.Event()

    def __str__(self) -> str:
        told = self._report if self._rate else f"{self._report.n_points:,} points, as fast as they were taken"
        return f"{self._bag.path}: {told}{f'; {self.problem}' if self.problem else ''}"

    @property
    def is_over(self) -> bool:
        """Whether all has been handed over; InputError if a message could not be read, or none was a scan."""
        if self._error is not None:
            raise self._error
        return self._is_over.is_set()

    @contextmanager
    def playing_to(self, feed: LiveFeed) -> Iterator[None]:
        """Play to a feed until the bag or the block is over."""
        thread = threading.Thread(target=self._run, args=(feed,), name="replay", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._is_stopping.set()
            thread.join()

    def _run(self, feed: LiveFeed) -> None:
        try:
            messages = chosen_messages(self._bag, self._topics, self._choice)
            with self._bag, closing(ahead(messages, _AHEAD)) as read:
                self._play(read, feed)
        except Exception as error:
            self._error = error
        self._is_over.set()

    def _play(self, messages: Iterable[BagMessage], feed: LiveFeed) -> None:
        pace = Pace(self._report, _PAUSE, wait=self._is_stopping.wait)
        frame: MapFrame | None = None
        for message in messages:
            if message.type in (POINT, VECTOR):
                frame = told_frame(message, frame or MapFrame())
                continue
            if frame is not None:  # what holds for the whole bag comes first
                feed.add_frame(frame)
                frame = None
            if self._rate and message.topic not in self._topics.of_whole:
                pace.wait_for(round(message.time / self._rate))
            while feed.fullness > _MOST_WAITING and not self._is_stopping.wait(_TICK):
                pass
            if self._is_stopping.is_set():
                return
            if message.type == CLOUD:
                self._report.n_scans += 1
                self._report.n_points += int(message.message.width) * int(message.message.height)
            elif message.type == FIX:
                feed.add_fix(message.message)
            hand_over(message, feed)
        if not self._report.n_scans:
            raise InputError(f"{self._bag.path}: {NO_SCAN}")
