"""How loops are compiled: numba's `njit` with the options that all loops of the package share."""

from collections.abc import Callable
from typing import Any

from numba import njit


def kernel(function: Callable[..., Any]) -> Any:
    """
    Compile a loop when it is first called, and keep the machine code on disk.

    It lets other threads run, and divides as numpy does. Give it arguments of one kind, int64 and float64
    arrays and numbers: each other kind is compiled once more.
    """
    return njit(nogil=True, cache=True, error_model="numpy")(function)


def inner_kernel(function: Callable[..., Any]) -> Any:
    """
    Compile a few lines of arithmetic as a part of the loops that call it, whatever kind its arguments are of.

    It has no machine code of its own unless Python calls it. What is longer, or calls much, is a `kernel`:
    copies within copies take minutes to compile.
    """
    return njit(nogil=True, cache=True, error_model="numpy", inline="always")(function)
