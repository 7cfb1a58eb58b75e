"""Waiting for a condition, which is what a test is about: never for a time, nor for what comes beside it."""

import time


def wait_until(condition, seconds=240.0):
    """Wait until a condition holds, so long at most: much longer than on a machine that is busy."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)
