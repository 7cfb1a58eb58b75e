"""The few errors that this package raises for what a user can cause, and what an exit status says."""

from enum import IntEnum


def printable(text: str) -> str:
    """Return a text on one line, with escapes for what a terminal would obey or cannot show, as in names."""
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in text)


class LidarBuildingsError(Exception):
    """Root of the package's errors; each message says on a line what is wrong and what to do."""

    def __str__(self) -> str:
        """Return the lines."""
        return "\n".join(printable(str(line)) for line in self.args)


class InputError(LidarBuildingsError):
    """An input file, folder or message cannot be read."""


class OutputError(LidarBuildingsError):
    """The output folder cannot be used, or a file cannot be written."""


class ParameterError(LidarBuildingsError, ValueError):
    """A parameter name is unknown or its value is out of range."""


class MessageError(InputError):
    """A message does not hold what its topic promises; the message says which field and what is allowed."""


class ExitStatus(IntEnum):
    """How a process ended."""

    DONE = 0
    DEFECT = 1  #: an exception that nobody foresaw
    WRONG_USE = 2  #: wrong usage, unreadable input, or an output that is missing for that
    TILE_FAILED = 3  #: a tile failed; the rest is done
    DOUBTFUL = 4  #: done, but look: a result that the user wants to see before it is used
    INTERRUPTED = 130
