"""The few errors that this package raises for what a user can cause."""


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
