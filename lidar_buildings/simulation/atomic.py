"""Files that appear under their name only when they are complete."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import laspy
import pyogrio

from lidar_buildings.core.model.errors import OutputError

#: What the writers raise when a file cannot be written.
WRITE_ERRORS = (OSError, laspy.errors.LaspyException, pyogrio.errors.DataSourceError, RuntimeError)


def write_whole(path: Path, write: Callable[[Path], None]) -> None:
    """
    Let `write` make a file beside `path`, then give it its name.

    Raises
    ------
    OutputError
        If it cannot be written; nothing is left behind.
    """
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        part.unlink(missing_ok=True)
        write(part)
        os.replace(part, path)
    except WRITE_ERRORS as error:
        raise OutputError(
            f"{path}: cannot be written ({error}): choose a writable folder with space"
        ) from error
    finally:
        _remove(part)


def make_folder(folder: Path) -> None:
    """
    Make a folder and those above it, unless they are there.

    Raises
    ------
    OutputError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}): choose another folder") from error


def _remove(part: Path) -> None:
    """Remove what an error left, if that can be done."""
    try:
        part.unlink(missing_ok=True)
    except OSError:
        return
