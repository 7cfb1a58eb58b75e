"""What a run notes of a file when it opens it, to see that it stays as it is."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.files.failures import reported
from lidar_buildings.io.files.locations import state_of


class InputFile(NamedTuple):
    """One input of a run."""

    path: Path
    point_count: int
    #: Its size [bytes] and when it was last changed [ns], where it is to stay as it is.
    state: tuple[int, int] | None = None
    kept: Path | None = None  #: where its points are decoded, once they have been read


def check_unchanged(file: InputFile) -> None:
    """Refuse a file that was replaced, or written to, since its state was noted; InputError if it was."""
    with reported(file.path):
        if file.state is not None and state_of(file.path) != file.state:
            raise changed(file.path)


def changed(path: Path) -> InputError:
    """Return what is said of a file that is not the one it was."""
    return InputError(f"{path}: has changed during the run: run it again with --overwrite")
