"""Warnings about files, each said once though a run opens a file several times."""

import logging
from functools import cache

_log = logging.getLogger("lidar_buildings.io")


@cache
def warn_once(text: str) -> None:
    """Log a warning unless the same one was logged before."""
    _log.warning("%s", text)
