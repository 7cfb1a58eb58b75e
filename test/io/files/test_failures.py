"""Failures of compiled code: on one line, and without its own output."""

import os
from pathlib import Path

import pytest

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.files.failures import captured_panics, captured_stderr, one_line, reported


class PanicException(BaseException):
    pass


@pytest.mark.parametrize("error", [PanicException("no room"), ValueError("no room")])
def test_panics_are_failures(error):
    with pytest.raises(InputError, match=r"a\.laz: cannot be decoded \(no room\)"), reported(Path("a.laz")):
        raise error


@pytest.mark.parametrize("wish", [KeyboardInterrupt, SystemExit, GeneratorExit, MemoryError])
def test_wishes_to_stop_are_none(wish):
    with pytest.raises(wish), reported(Path("a.laz")):
        raise wish


def test_words_fit_on_one_line():
    assert one_line(ValueError("one\n  two")) == "one two"
    assert one_line(OSError(28, "No space left on device", "/a/file")) == "No space left on device"
    assert one_line(RuntimeError()) == "RuntimeError"


def printing(text, error=None, quiet=captured_panics):
    with quiet():
        os.write(2, text)
        if error is not None:
            raise error


def test_what_a_panic_prints_past_python_is_dropped(capfd):
    with pytest.raises(PanicException):
        printing(b"thread panicked at src/lib.rs:1\n", PanicException())
    assert capfd.readouterr().err == ""


def test_what_others_print_meanwhile_is_passed_on(capfd):
    printing(b"progress: 3 of 4\n")
    with pytest.raises(ValueError, match="x"):
        printing(b"progress: 4 of 4\n", ValueError("x"))
    os.write(2, b"done\n")
    assert capfd.readouterr().err == "progress: 3 of 4\nprogress: 4 of 4\ndone\n"


def test_of_other_errors_what_they_print_is_dropped_on_request(capfd):
    full = b"_tiffWriteProc: No space left on device.\n"
    with pytest.raises(OSError, match="full"):
        printing(full, OSError("full"), lambda: captured_stderr(lambda error: isinstance(error, OSError)))
    assert capfd.readouterr().err == ""
