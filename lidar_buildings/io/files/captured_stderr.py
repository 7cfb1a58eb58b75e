"""Errors of compiled code: as one line of text, without what the code itself prints to standard error."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

#: One redirection of the process's standard error at a time.
_one_redirection = threading.Lock()

_STANDARD_ERROR = 2

#: Class name of what a Rust extension raises when it panics; it derives from BaseException alone.
_PANIC = "PanicException"


def is_failure(error: BaseException) -> bool:
    """Whether `error` is a failure to report, not a request to stop (Ctrl-C, exit)."""
    return isinstance(error, Exception) or type(error).__name__ == _PANIC


def one_line(error: BaseException) -> str:
    """Return the error's message on one line, without the file name that an OSError repeats."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split()) or type(error).__name__


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
    with _one_redirection, tempfile.TemporaryFile() as captured:
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
                _print_captured(captured.fileno())


def _print_captured(captured: int) -> None:
    os.lseek(captured, 0, os.SEEK_SET)
    while block := os.read(captured, 65536):
        os.write(_STANDARD_ERROR, block)
