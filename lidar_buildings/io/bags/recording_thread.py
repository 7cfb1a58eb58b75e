"""Recording in a thread of its own: who listens never waits for the disk, and memory is bounded."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

from lidar_buildings.io.bags.recording import Recording

#: Bytes of messages that may wait for the disk.
MOST_WAITING = 500_000_000


class RecordingThread:
    """
    Writes messages in the order in which they came; what the disk is too slow for is left out and counted.

    Parameters
    ----------
    recording : Recording
        Where they go; its `lost` counts what is left out.
    on_written : callable
        Called, from the thread, with the topic and the time [ns] of each message that was its turn.
    most_waiting : int
        Bytes that may wait; a single message may be larger.
    """

    def __init__(
        self,
        recording: Recording,
        on_written: Callable[[str, int], None],
        most_waiting: int = MOST_WAITING,
    ) -> None:
        self._recording, self._on_written, self._most = recording, on_written, most_waiting
        self._messages: queue.SimpleQueue[tuple[str, int, bytes | None] | None] = queue.SimpleQueue()
        self._n_taken = self._n_left = 0
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()

    @property
    def n_waiting(self) -> int:
        """Bytes that wait."""
        return self._n_taken - self._n_left

    def add(self, name: str, time: int, data: bytes) -> None:
        """Take a message that came at a time [ns]."""
        has_room = not self.n_waiting or self.n_waiting + len(data) <= self._most
        self._n_taken += len(data) * has_room
        self._messages.put((name, time, data if has_room else None))

    def finish(self) -> None:
        """Return when all that was taken is written, and take no more."""
        self._messages.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (message := self._messages.get()) is not None:
            name, time, data = message
            if data is None:
                self._recording.leave_out(name)
            else:
                self._recording.add(name, time, data)
                self._n_left += len(data)
            self._on_written(name, time)
