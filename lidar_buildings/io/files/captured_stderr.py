"""What a compiled decoder throws: turned into words, and its own printing kept off the screen."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

#: One redirection of the process's standard error at a time.
_one_at_a_time = threading.Lock()

_STANDARD_ERROR = 2

#: Class name of what a Rust extension raises when it panics; it derives from BaseException alone.
_PANIC = "PanicException"


def is_failure(error: BaseException) -> bool:
    """Whether `error` tells of a failure to report, not of a wish to stop (Ctrl-C, exit)."""
    return isinstance(error, Exception) or type(error).__name__ == _PANIC


def in_words(error: BaseException) -> str:
    """Return the error's message on one line, without the file name that an OSError repeats."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split()) or type(error).__name__


def quiet_panics() -> AbstractContextManager[None]:
    """
    Hold back what is printed to standard error meanwhile, and drop it if the block panics.

    A panicking decoder prints its backtrace from compiled code.
    """
    return quiet_if(lambda error: type(error).__name__ == _PANIC)


@contextmanager
def quiet_if(is_noisy: Callable[[BaseException], bool]) -> Iterator[None]:
    """
    Hold back what is printed to standard error meanwhile, and drop it if the block ends with such an error.

    Compiled code prints past `sys.stderr`; so the file descriptor itself is redirected, for as short as
    possible since it belongs to the whole process. Whatever was printed is passed on when the block ends
    well, or with an error that prints nothing of its own.

    Parameters
    ----------
    is_noisy : callable
        Whether an error is of the kind that prints.
    """
    with _one_at_a_time, tempfile.TemporaryFile() as held:
        try:
            saved = os.dup(_STANDARD_ERROR)
        except OSError:  # standard error is closed: nothing to hold back
            yield
            return
        os.dup2(held.fileno(), _STANDARD_ERROR)
        dropped = False
        try:
            yield
        except BaseException as error:
            dropped = is_noisy(error)
            raise
        finally:
            os.dup2(saved, _STANDARD_ERROR)
            os.close(saved)
            if not dropped:
                _pass_on(held.fileno())


def _pass_on(held: int) -> None:
    """Print what was held back."""
    os.lseek(held, 0, os.SEEK_SET)
    while block := os.read(held, 65536):
        os.write(_STANDARD_ERROR, block)
