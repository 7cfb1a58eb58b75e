"""What is wrong with a message."""

from lidar_buildings.core.model.errors import InputError


class MessageError(InputError):
    """A message does not hold what its topic promises; the message says which field and what is allowed."""
