"""Failures of what reads and writes files: one line, without what compiled code prints on its own."""

from __future__ import annotations

import logging
import os
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from lidar_buildings.core.model.errors import InputError, printable

#: One redirection of the process's standard error at a time.
_one_redirection = threading.Lock()

_STANDARD_ERROR = 2

#: Class name of what a Rust extension raises when it panics; it derives from BaseException alone.
_PANIC = "PanicException"


def one_line(error: BaseException) -> str:
    """Return the error's message on one line, without the file name that an OSError repeats."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split()) or type(error).__name__


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
            f"{path}: cannot be opened ({one_line(error)}): check the file and its permissions"
        ) from error
    except BaseException as error:
        is_request = not isinstance(error, Exception) and type(error).__name__ != _PANIC  # as of Ctrl-C
        if is_request or isinstance(error, MemoryError):
            raise
        raise InputError(
            f"{path}: cannot be decoded ({one_line(error)}): it is damaged, or of a kind that is not "
            "supported; download it again, or convert it with a current LAS tool"
        ) from None


def captured_panics() -> AbstractContextManager[None]:
    """Capture standard error; drop the backtrace that a panicking Rust extension prints."""
    return captured_stderr(lambda error: type(error).__name__ == _PANIC)


@contextmanager
def captured_stderr(drops: Callable[[BaseException], bool]) -> Iterator[None]:
    """
    Capture standard error during a block, and print it at its end unless the block raised what `drops` names.

    Compiled code bypasses `sys.stderr`, so the file descriptor itself is redirected: briefly, since it
    belongs to the whole process.
    """
    with _one_redirection, tempfile.TemporaryFile(buffering=0) as captured:
        try:
            saved = os.dup(_STANDARD_ERROR)
        except OSError:  # standard error is closed: nothing to capture
            yield
            return
        os.dup2(captured.fileno(), _STANDARD_ERROR)
        dropped = False
        try:
            yield
        except BaseException as error:
            dropped = drops(error)
            raise
        finally:
            os.dup2(saved, _STANDARD_ERROR)
            os.close(saved)
            if not dropped:
                captured.seek(0)
                while block := captured.read(65536):
                    os.write(_STANDARD_ERROR, block)


_PACKAGE = "lidar_buildings"
_log = logging.getLogger(f"{_PACKAGE}.io")
#: What was said.
SAID: set[str] = set()


def warn_once(text: str) -> None:
    """Log a warning unless the same one was logged before."""
    _log.warning("%s", printable(text))


def log_to_terminal() -> None:
    """Print what this package logs, a line each; what libraries log and warn of is no message for users."""
    handler = logging.StreamHandler()
    handler.addFilter(lambda record: record.name.partition(".")[0] == _PACKAGE)
    logging.basicConfig(format="lidar-buildings: %(message)s", level=logging.WARNING, handlers=[handler])
    if not sys.warnoptions:
        warnings.simplefilter("ignore")


def _is_new(record: logging.LogRecord) -> bool:
    """Let a record through once, whether it is of this process or came from another one."""
    text = record.getMessage()
    is_new = text not in SAID
    SAID.add(text)
    return is_new


_log.addFilter(_is_new)
