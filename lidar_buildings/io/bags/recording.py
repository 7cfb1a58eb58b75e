"""A bag of what is heard, in a thread of its own, which may fail without ending what is recorded."""

from __future__ import annotations

import os
import queue
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from rosbags.interfaces import Qos

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.bags.bag_writer import BagWriter
from lidar_buildings.io.files.failures import one_line

_MCAP = ".mcap"
#: Bytes of messages that may wait for the disk.
MOST_WAITING = 500_000_000


class Recording:
    """
    A bag that is made with its first message, a folder that must not be there.

    What is too much for the disk is left out: so many bytes may wait; a single message may be larger. `lost`
    leads from a topic to the messages that were left out, or came after the bag could not be written any
    more; `failure` is why it cannot be written, or not all of it, empty if it can. OutputError if something
    of that name is there, or no folder can be made there.
    """

    def __init__(self, path: Path, most_waiting: int = MOST_WAITING) -> None:
        self.path = path
        self.n_messages = self.n_bytes = 0
        self.lost: Counter[str] = Counter()
        self.failure = ""
        self._has_ended = False
        self._topics: dict[str, tuple[str, Qos]] = {}
        self._bag: BagWriter | None = None
        self._most, self._n_taken, self._n_left = most_waiting, 0, 0
        self._waiting: queue.SimpleQueue[tuple[str, int, bytes | None] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        if path.exists():
            raise OutputError(f"{path}: is there already: choose another name for the bag, or remove it")
        above = next(one for one in path.absolute().parents if one.exists())
        if not above.is_dir() or not os.access(above, os.W_OK):
            raise OutputError(f"{path}: cannot be written: {above} is no folder that can be written to")

    def declare(self, name: str, kind: str, qos: Qos) -> None:
        """Say of what type a topic is, and how it is to be played, before its first message."""
        self._topics[name] = kind, qos

    def start(self, on_written: Callable[[str, int], None]) -> None:
        """
        Begin to write what comes, in its order, in a thread of its own.

        `on_written` is called, from that, with the topic and the time [ns] of each message that was its turn.
        """
        self._thread = threading.Thread(target=self._run, args=(on_written,), name="recording", daemon=True)
        self._thread.start()

    @property
    def n_waiting(self) -> int:
        """Bytes that wait."""
        return self._n_taken - self._n_left

    def add(self, name: str, time: int, data: bytes) -> None:
        """Take a message (CDR) that came at a time [ns]."""
        has_room = not self.n_waiting or self.n_waiting + len(data) <= self._most
        self._n_taken += len(data) * has_room
        self._waiting.put((name, time, data if has_room else None))

    def close(self) -> None:
        """Complete the bag when all that was taken is written, and take no more."""
        if self._thread is not None:
            self._waiting.put(None)
            self._thread.join()
            self._thread = None
        if self._bag is not None:
            try:
                self._bag.close()
            except OutputError as error:
                self._give_up(error)
            self._bag = None

    def _run(self, on_written: Callable[[str, int], None]) -> None:
        while (message := self._waiting.get()) is not None:
            name, time, data = message
            if data is None:
                self.lost[name] += 1
                slow = f"{self.path}: the disk is too slow: what it cannot take is left out"
                self.failure = self.failure or slow
            else:
                self._write(name, time, data)
                self._n_left += len(data)
            on_written(name, time)

    def _write(self, name: str, time: int, data: bytes) -> None:
        """Write a message; once that fails, only count it."""
        if self._has_ended:
            self.lost[name] += 1
            return
        try:
            self._opened().write_serialised(name, self._topics[name][0], time, data)
        except OutputError as error:
            self._give_up(error)
            self.lost[name] += 1
            return
        self.n_messages += 1
        self.n_bytes += len(data)

    def _opened(self) -> BagWriter:
        """Return the bag, with all its topics."""
        if self._bag is None:
            self._bag = BagWriter(self.path)
            for name, (kind, qos) in self._topics.items():
                self._bag.add_topic(name, kind, qos)
        return self._bag

    def _give_up(self, error: OutputError) -> None:
        why = one_line(error.__cause__ or error)
        self.failure = (
            f"{self.path}: cannot be written any more ({why}): what is whole of it stays, and "
            "`mcap recover` mends it"
        )
        if self._bag is not None:
            self._bag.abandon()
            self._bag = None
        self._has_ended = True


def bag_folder(name: str | Path) -> Path:
    """Return the folder of a bag that a user calls so: ``flight`` for ``flight.mcap``, a file within it."""
    path = Path(name)
    return path.with_suffix("") if path.suffix.lower() == _MCAP else path
