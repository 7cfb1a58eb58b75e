"""The few errors that this package raises for what a user can cause, and what an exit status says."""

from enum import IntEnum


class LidarBuildingsError(Exception):
    """Root of the package's errors; the message says what is wrong and what to do."""


class InputError(LidarBuildingsError):
    """An input file, folder or message cannot be read."""


class OutputError(LidarBuildingsError):
    """The output folder cannot be used, or a file cannot be written."""


class ParameterError(LidarBuildingsError, ValueError):
    """A parameter name is unknown or its value is out of range."""


class MessageError(InputError):
    """A message does not hold what its topic promises; the message says which field and what is allowed."""


class ExitStatus(IntEnum):
    """How a process ended; 1 is left to unexpected exceptions."""

    DONE = 0
    WRONG_USE = 2  #: wrong usage, unreadable input, or an output that is missing for that
    TILE_FAILED = 3  #: a tile failed; the rest is done
    DOUBTFUL = 4  #: done, but look: a result that the user wants to see before it is used
    INTERRUPTED = 130
