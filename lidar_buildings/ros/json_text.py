"""JSON that topics of text carry."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, TypeVar

from std_msgs.msg import String

from lidar_buildings.core.model.errors import MessageError

#: Characters of a message; wide margin: the outlines of a tile take 200 each.
MAX_LENGTH = 20_000_000
_Said = TypeVar("_Said")


def read_json(topic: str, message: String, read: Callable[[Any], _Said]) -> _Said:
    """
    Return what `read` makes of a message's JSON.

    MessageError if the text is no JSON, longer than `MAX_LENGTH`, or `read` does not find in it what it looks
    for.
    """
    text = message.data
    try:
        if len(text) > MAX_LENGTH:
            raise ValueError(f"{len(text)} characters: must be at most {MAX_LENGTH}")
        return read(json.loads(text))
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError) as error:
        raise MessageError(f"{topic} is not understood: {error!r}: {text[:100]}") from error
