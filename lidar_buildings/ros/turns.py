"""Work of a node that gives way to other work of the node while a process is at it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Generator
from contextlib import suppress
from typing import Any

from rclpy.node import Node

#: Work that yields, whenever it has to wait, what calls a function once the waiting is over.
Turns = Generator[Callable[[Callable[[], None]], object], None, Any]


class TurnTaking:
    """Goes on with such work in the thread of a node's executor, as that with messages."""

    def __init__(self, node: Node) -> None:
        self._due: deque[Turns] = deque()
        self._lock = threading.Lock()
        self._is_closed = False
        self._guard = node.create_guard_condition(self._on_due)

    def begin(self, work: Turns) -> None:
        """Do what comes before the first waiting."""
        with suppress(StopIteration):
            next(work)(lambda: self._put(work))

    def close(self) -> None:
        """Go on with nothing more."""
        with self._lock:
            self._is_closed = True

    def _put(self, work: Turns) -> None:
        with self._lock:
            if not self._is_closed:
                self._due.append(work)
                self._guard.trigger()

    def _on_due(self) -> None:
        while self._due:
            self.begin(self._due.popleft())
