"""An output folder belongs to one run at a time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.results.run_folder import LOCK, PARTIAL, usable

#: Folders that this process has: locks of POSIX do not keep a process from itself.
_mine: set[Path] = set()


@contextmanager
def sole_use(path: Path) -> Iterator[None]:
    """
    Keep a folder from the runs of other processes; it is made if it is not there.

    The kernel releases the lock when the process ends, however that comes about; processes that it has forked
    do not have it. Where the file system has no locks nothing is kept. A part of this process that takes the
    folder again, as a node of the graph, has it already. OutputError if another process has it, or it cannot
    be made.
    """
    folder = path.resolve()
    if folder in _mine:
        yield
        return
    was_there = folder.exists()
    with usable(path):
        (folder / PARTIAL).mkdir(parents=True, exist_ok=True)
        try:
            descriptor = _locked(folder / PARTIAL / LOCK)
        except BlockingIOError as error:
            raise OutputError(
                f"{path}: another run writes into it: wait for its end, or choose another folder"
            ) from error
    _mine.add(folder)
    try:
        yield
    finally:
        _mine.discard(folder)
        with suppress(OSError):  # what holds something else stays
            (folder / PARTIAL / LOCK).unlink(missing_ok=True)
            os.close(descriptor)
            (folder / PARTIAL).rmdir()
            if not was_there:
                folder.rmdir()


def _locked(path: Path) -> int:
    """Open a file and lock it; one that its last owner deleted meanwhile is none."""
    import fcntl  # not there on Windows

    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            raise
        except OSError:  # a file system without locks
            return descriptor
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(descriptor), os.stat(path)):
                return descriptor
        os.close(descriptor)
