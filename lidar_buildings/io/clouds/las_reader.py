"""Readers of laspy."""

from __future__ import annotations

import logging
import multiprocessing
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import laspy

from lidar_buildings.io.files.captured_stderr import captured_panics
from lidar_buildings.io.files.locations import open_binary

# what laspy logs of a failing file is said again in the one line of the InputError
for _name in ("laspy.lasreader", "laspy.header"):
    logging.getLogger(_name).addFilter(lambda record: record.levelno < logging.ERROR)


def laz_backend() -> laspy.LazBackend:
    """
    Return the parallel backend, in a process of a pool the sequential one.

    A process that was forked has none of the threads that lazrs had started before, and would wait for them.
    """
    is_of_a_pool = multiprocessing.parent_process() is not None
    return laspy.LazBackend.Lazrs if is_of_a_pool else laspy.LazBackend.LazrsParallel


@contextmanager
def open_reader(path: Path) -> Iterator[tuple[Any, Any]]:
    """
    Open a reader with the backend of this process, or the sequential one for files without a chunk table.

    The second item is a context for each read: the sequential backend may panic on damaged or very old files.
    """
    backend = laz_backend()
    try:
        reader = laspy.open(open_binary(path), laz_backend=backend, read_evlrs=False)
        guard: Any = nullcontext if backend is laspy.LazBackend.LazrsParallel else captured_panics
        if reader.header.point_count:
            _ = reader.point_source  # raises here where the parallel backend cannot serve
    except (laspy.errors.LaspyException, RuntimeError, ValueError):
        reader = laspy.open(open_binary(path), laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False)
        guard = captured_panics
    with reader:
        yield reader, guard
