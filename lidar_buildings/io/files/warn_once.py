"""Warnings about files, each said once though a run opens a file several times, in several processes."""

import logging

_log = logging.getLogger("lidar_buildings.io")
#: What was said.
SAID: set[str] = set()


def warn_once(text: str) -> None:
    """Log a warning unless the same one was logged before."""
    _log.warning("%s", text)


def _is_new(record: logging.LogRecord) -> bool:
    """Let a record through once, whether it is of this process or came from another one."""
    text = record.getMessage()
    is_new = text not in SAID
    SAID.add(text)
    return is_new


_log.addFilter(_is_new)
