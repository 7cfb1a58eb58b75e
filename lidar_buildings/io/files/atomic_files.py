"""Files that appear under their final name only when they are complete."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import uuid
from collections.abc import Hashable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, Generic, TypeVar

from lidar_buildings.core.model.errors import LidarBuildingsError, OutputError
from lidar_buildings.io.files.failures import one_line


@contextmanager
def atomic_file(
    path: Path, failures: tuple[type[BaseException], ...] = (OSError,), *, has_rivals: bool = False
) -> Iterator[Path]:
    """
    Give a temporary name in the file's own folder, and rename it to `path` when the block ends well.

    `failures` are what the block's writer raises when it cannot write. With rivals another process may write
    the same file at the same time: the last one's stays. OutputError if it cannot be written; nothing is left
    behind, and what stood under `path` is untouched.
    """
    # the ending stays, since some drivers go by it
    own = f".{uuid.uuid4().hex}" if has_rivals else ""
    temporary = path.with_name(f".{path.name.removesuffix(path.suffix)}{own}.part{path.suffix}")
    try:
        with writing(path, failures):
            temporary.unlink(missing_ok=True)
            yield temporary
            os.replace(temporary, path)
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """
    Give a new folder under a temporary name, and put it in the place of `path` when the block ends well.

    OutputError if it cannot be written; nothing is left behind, and what stood under `path` is untouched.
    """
    temporary, former = (path.with_name(f".{path.name}.{ending}") for ending in ("part", "former"))
    try:
        with writing(path):
            for left in (temporary, former):
                shutil.rmtree(left, ignore_errors=True)
            temporary.mkdir()
            yield temporary
            if path.exists():  # a folder that is not empty cannot be replaced
                os.replace(path, former)
            os.replace(temporary, path)
    finally:
        for left in (temporary, former):
            shutil.rmtree(left, ignore_errors=True)


@contextmanager
def writing(path: Path, failures: tuple[type[BaseException], ...] = (OSError,)) -> Iterator[None]:
    """Turn what fails in writing a file into one OutputError that names it."""
    try:
        yield
    except failures as error:
        raise write_error(path, error) from error


def write_error(path: Path, error: BaseException) -> OutputError:
    """Return the error of a file that cannot be written; a run may be resumed."""
    return OutputError(
        f"{path}: cannot be written ({one_line(error)}): free some space or check the permissions, "
        "then repeat the command; a run resumes from its finished tiles"
    )


@contextmanager
def checked_file(path: Path) -> Iterator[Any]:
    """Give an `atomic_file` for compiled writers, which hide why writing failed: OutputError says it."""
    with atomic_file(path) as temporary, open(temporary, "wb+") as plain:
        file = _CheckedFile(plain)
        try:
            yield file
        except LidarBuildingsError:
            raise
        except Exception as error:
            if file.error is None:
                raise
            raise write_error(path, file.error) from error


class _CheckedFile:
    """A binary file that remembers why writing failed."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        try:
            return self._file.write(data)
        except OSError as error:
            self.error = error
            raise

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def compact_json(content: Any) -> str:
    """Return content as JSON; only finite numbers are let through."""
    return json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


Key = TypeVar("Key", bound=Hashable)
Item = TypeVar("Item")


class Waiting(Generic[Key, Item]):
    """Keeps things in a binary file, open for writing and reading, and in memory the place of each."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.places: dict[Key, list[int]] = {}

    def add(self, key: Key, item: Item) -> None:
        """Keep something."""
        self.places.setdefault(key, []).append(self._file.tell())
        pickle.dump(item, self._file, protocol=pickle.HIGHEST_PROTOCOL)

    def of(self, key: Key) -> Iterator[Item]:
        """Yield what was kept under a key, in the order in which it came."""
        for place in self.places.get(key, ()):
            self._file.seek(place)
            yield pickle.load(self._file)
