"""Temporary folders, of which none stays for long when its process has been killed."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.files.failures import one_line

_PREFIX = "lidar_buildings_run_"
#: A folder is deleted again where a file was just being added: once a thread; wide margin.
_ATTEMPTS = 10
#: Folders of this process → what keeps them locked.
_locks: dict[Path, int] = {}


@contextmanager
def temporary_files(folder: str | Path) -> Iterator[None]:
    """Turn what fails in writing to a temporary folder into one OutputError."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"{folder}: temporary files cannot be written ({one_line(error)}): "
            "free some space, or set TMPDIR to a folder with more"
        ) from error


def make_temporary_folder(place: str | Path | None = None) -> Path:
    """
    Make a folder in a place that somebody clears, or in the system's.

    There those are deleted that killed processes have left: the kernel releases a folder's lock when its
    process and all that this has forked have ended. Without locks nothing is deleted. OutputError if it
    cannot be made.
    """
    with temporary_files(place or tempfile.gettempdir()):
        return Path(tempfile.mkdtemp(dir=place)) if place else _locked_folder(tempfile.gettempdir())


def remove_folder(path: Path) -> None:
    """Delete everything, also what another thread adds meanwhile, which by another name it cannot."""
    folder = path.with_name(f"{path.name}.removed")
    try:
        path.rename(folder)
    except OSError:
        folder = path
    for _ in range(_ATTEMPTS):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            break
    if (lock := _locks.pop(path, None)) is not None:
        os.close(lock)


def _locked(folder: Path) -> int:
    """Open a folder and lock it; BlockingIOError if it is locked."""
    import fcntl  # not there on Windows

    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        # unlike `lockf` it is kept by forked processes, and not lost when the folder is opened again
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def _locked_folder(place: str) -> Path:
    """Make a folder and lock it; delete those in the same place that nobody has locked."""
    for left in Path(place).glob(f"{_PREFIX}*"):
        with suppress(OSError):
            lock = _locked(left)
            remove_folder(left)
            os.close(lock)
    while True:
        folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=place))
        try:
            _locks[folder] = _locked(folder)
        except (BlockingIOError, FileNotFoundError):
            continue  # another process has taken it for one that was left
        except OSError:
            return folder
        if folder.exists():
            return folder
        os.close(_locks.pop(folder))
