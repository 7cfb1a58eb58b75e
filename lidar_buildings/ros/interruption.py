"""SIGINT and SIGTERM of a node's process."""

from __future__ import annotations

import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Thread
from types import FrameType

#: What ends a node.
_ENDING = (signal.SIGINT, signal.SIGTERM)


class Interruption:
    """
    Makes a KeyboardInterrupt of SIGINT and of SIGTERM until `disregard_signals`.

    Start ROS without handlers of its own (``SignalHandlerOptions.NO``). Those of rclpy wake the executor
    *before* they shut the context down: an executor that is quick finds nothing to end for, and waits on for
    good. A node that is still being made meets the end of its context in rclpy's C++, which reports it as an
    error. Python's handler marks the exception first, and what waits is woken after.

    Make it in the main thread, before ROS starts.
    """

    def __init__(self) -> None:
        self._is_over = False
        for number in _ENDING:
            signal.signal(number, self._on_signal)

    def disregard_signals(self) -> None:
        """Raise nothing from here on: the process ends, and a launch system sends several signals."""
        self._is_over = True

    @staticmethod
    def ignore_signals() -> None:
        """Keep a late signal from ending the process before Python has."""
        for number in _ENDING:
            signal.signal(number, signal.SIG_IGN)

    @contextmanager
    def waking(self, wake: Callable[[], None]) -> Iterator[None]:
        """Have `wake` called, in another thread, after each signal; nothing disturbs the end of the block."""
        receiver, sender = socket.socketpair()
        sender.setblocking(False)
        thread = Thread(target=_wake_whenever, args=(receiver, wake), daemon=True)
        thread.start()
        signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
        try:
            yield
        finally:
            self.disregard_signals()
            signal.set_wakeup_fd(-1)
            sender.close()
            thread.join()
            receiver.close()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if not self._is_over:
            raise KeyboardInterrupt


def _wake_whenever(receiver: socket.socket, wake: Callable[[], None]) -> None:
    """Wake for whatever comes, until the other end is closed."""
    while receiver.recv(64):
        wake()
