"""Whether the times of messages are those of one clock, which may be set back now and then."""

from __future__ import annotations

from collections import deque

#: A clock that is set back so often within so many messages is none: two senders tell their own times.
_OFTEN, _MESSAGES = 3, 1_000


class ClockWatch:
    """Tells clocks that are set back from two clocks whose messages alternate."""

    def __init__(self) -> None:
        self._n = 0
        self._set_back: deque[int] = deque(maxlen=_OFTEN)
        self._later_came = 0

    def is_of_another(self, *, is_earlier: bool) -> bool:
        """
        Whether a message is of a second clock: the earlier one, as long as messages of the later one come.

        Parameters
        ----------
        is_earlier : bool
            Whether its time is so much earlier than the last that the clock was set back, if there is one.
        """
        self._n += 1
        if not is_earlier:
            self._later_came = self._n
            return False
        if self._n - self._later_came > _MESSAGES:
            self._set_back.clear()
        elif len(self._set_back) == _OFTEN and self._set_back[-1] - self._set_back[0] <= _MESSAGES:
            return True
        self._set_back.append(self._n)
        return False
