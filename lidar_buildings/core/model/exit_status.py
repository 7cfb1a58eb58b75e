"""What the exit status of commands and nodes says."""

from enum import IntEnum


class ExitStatus(IntEnum):
    """How a process ended; 1 is left to unexpected exceptions."""

    DONE = 0
    WRONG_USE = 2  #: wrong usage, unreadable input, or an output that is missing for that
    TILE_FAILED = 3  #: a tile failed; the rest is done
    INTERRUPTED = 130
