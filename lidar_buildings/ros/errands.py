"""What a node does in its turn beside the messages that come: what others in its process leave for it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from concurrent.futures import Future
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any

from rclpy.node import Node

#: Work that yields, whenever it has to wait, what it waits for.
Turns = Generator["Future[Any]", None, Any]


class Errands:
    """
    Calls functions one after the other, and none beside a callback that holds `turn`.

    That is done in the thread of the node's executor, or in another one by `run`: an executor goes through
    all that its node listens to whenever it wakes, which takes ten times as long as most errands.
    """

    def __init__(self, node: Node) -> None:
        self.turn = threading.RLock()
        self._due: SimpleQueue[Callable[[], object] | None] = SimpleQueue()
        self._is_running = self._is_over = False
        self._guard = node.create_guard_condition(self._do_due)

    def put(self, errand: Callable[[], object]) -> None:
        """Have a function called, from any thread; none is any more after `stop`."""
        self._due.put(errand)
        if not (self._is_running or self._is_over):
            self._guard.trigger()

    def begin(self, work: Turns) -> None:
        """Do, now, what comes before the work's first waiting; the rest is an errand."""
        with suppress(StopIteration):
            next(work).add_done_callback(lambda _: self.put(lambda: self.begin(work)))

    def run(self) -> None:
        """Call what is due until `stop`; raises what a function raises."""
        self._is_running = True
        while not self._is_over and (errand := self._due.get()) is not None:
            with self.turn:
                errand()

    def stop(self) -> None:
        """Call nothing more."""
        self._is_over = True
        self._due.put(None)  # `run` may wait

    def _do_due(self) -> None:
        """Call what is due, until `run` does: it may begin, and take what there is, in the middle of this."""
        with suppress(Empty):
            while not (self._is_running or self._is_over):
                if (errand := self._due.get_nowait()) is None:
                    self._due.put(None)
                    return
                with self.turn:
                    errand()
