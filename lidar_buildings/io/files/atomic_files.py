"""Files that appear under their final name only when they are complete."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from lidar_buildings.core.model.errors import OutputError
from lidar_buildings.io.files.captured_stderr import in_words


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """
    Give a temporary name in the file's own folder, and rename it to `path` when the block ends well.

    Raises
    ------
    OutputError
        If it cannot be written; nothing is left behind, and what stood under `path` is untouched.
    """
    # the ending stays, since some drivers go by it
    temporary = path.with_name(f".{path.name.removesuffix(path.suffix)}.part{path.suffix}")
    try:
        temporary.unlink(missing_ok=True)
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        _remove(temporary)


def cannot_write(path: Path, error: BaseException) -> OutputError:
    """Say that a file cannot be written, and that a run may be taken up again."""
    return OutputError(
        f"{path}: cannot be written ({in_words(error)}): make room or mend the rights, "
        "then give the same command again; it goes on from the finished tiles"
    )


class CheckedFile:
    """
    A binary file that remembers why writing failed, since compiled writers hide it.

    Parameters
    ----------
    file : binary file
        Open for writing.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write, and remember a failure."""
        try:
            return self._file.write(data)
        except OSError as error:
            self.error = error
            raise

    def __getattr__(self, name: str) -> Any:
        """Leave everything else to the file."""
        return getattr(self._file, name)


def _remove(path: Path) -> None:
    """Remove a file if it is there and can be removed."""
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return
