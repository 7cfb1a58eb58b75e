"""Pause, step and speed of a recording."""

from __future__ import annotations

import time
from collections.abc import Callable


class Playback:
    """Says when a tile's time has come."""

    def __init__(self, *, is_paused: bool = False, now: Callable[[], float] = time.monotonic) -> None:
        self._is_paused = is_paused
        self._now = now
        self._steps = 0
        self._first: tuple[int, float] | None = None

    def pause(self) -> None:
        """Let no more tiles through."""
        self._is_paused = True

    def resume(self) -> None:
        """Go on from here, not from where the recording would be by now."""
        self._is_paused, self._steps, self._first = False, 0, None

    def step(self) -> bool:
        """Let one tile through; False if not paused."""
        self._steps += self._is_paused
        return self._is_paused

    def is_due(self, stamp: int, rate: float) -> bool:
        """Whether a tile's time has come at `rate` times the recorded speed; 0 means at once."""
        if self._is_paused:
            return self._steps > 0
        if not rate:
            return True
        if self._first is None:
            self._first = (stamp, self._now())
        first_stamp, started = self._first
        return self._now() - started >= (stamp - first_stamp) * 1e-9 / rate

    def sent(self) -> None:
        """Note that a tile was let through."""
        self._steps = max(0, self._steps - 1)
