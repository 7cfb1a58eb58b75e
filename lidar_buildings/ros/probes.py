"""
Empty tiles that show whether the graph is whole, and whether a tile got lost in it.

Topics keep their order. So a probe that comes back was handled by every node after all that was sent before
it, and a tile that was sent earlier and is not done must have been lost: in a node that was restarted, in a
subscription that was not matched yet, or by an error.

"""

from __future__ import annotations

import time
from collections.abc import Callable

#: Stamps below this [ns] are probes; no tile has one.
_STAMPS = 1_000_000
#: Time until the second probe while none came back, and between probes from then on, at least [s].
_SEARCHING, _LISTENING = 0.5, 2.0
#: The next probe leaves after so many times the way of the last one, so that probes cost a slow graph little.
_PATIENCE = 2.0


def is_probe(stamp: int) -> bool:
    """
    Whether a stamp is that of a probe.

    """
    return 0 <= stamp < _STAMPS


class Probes:
    """
    Says when to send a probe and what its answer means.

    Parameters
    ----------
    now : callable
        The clock [s].

    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._number = 0
        self._sent: dict[int, float] = {}
        self._next = now()
        self._interval = _SEARCHING
        self.has_answer = False

    def due(self) -> int | None:
        """
        Return the stamp of the probe to send now, None if it is too early.

        While no answer comes each waits twice as long, so that they do not pile up before a slow node.

        """
        now = self._now()
        if now < self._next:
            return None
        self._next = now + self._interval
        self._interval *= 2
        self._number = (self._number + 1) % _STAMPS
        self._sent[self._number] = now
        return self._number

    def answered(self, stamp: int) -> float | None:
        """
        Note that a probe came back; return when it was sent, None if it is not ours.

        """
        sent = self._sent.pop(stamp, None)
        if sent is None:
            return None
        self._sent = {number: time for number, time in self._sent.items() if time > sent}
        self.has_answer = True
        now = self._now()
        self._interval = max(_LISTENING, _PATIENCE * (now - sent))
        self._next = now + self._interval
        return sent
