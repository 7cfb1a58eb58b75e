"""Failures of what reads files as an `InputError` of one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.files.captured_stderr import is_failure, one_line


@contextmanager
def reported(path: Path) -> Iterator[None]:
    """Turn any failure of the block into one InputError that names the file."""
    try:
        yield
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{path}: no such file: check the path") from None
    except OSError as error:
        raise InputError(
            f"{path}: cannot be opened ({one_line(error)}): check the file and its rights"
        ) from error
    except BaseException as error:
        if not is_failure(error) or isinstance(error, MemoryError):
            raise
        raise InputError(
            f"{path}: cannot be decoded ({one_line(error)}): it is damaged, or of a kind that is not "
            "supported; download it again, or convert it with a current LAS tool"
        ) from None
