"""
How loops are compiled: `kernel` for those that Python calls, `inner_kernel` for those that only kernels call.

Numba takes some 0.3 s of a processor for each. Both leave out what is never used: the way in from C, copies
for each literal number that a loop passes on, and for inner ones the way in from Python and a file of their
own, as the files of their callers hold them.
"""

from collections.abc import Callable
from typing import Any

from numba import njit, types

_OPTIONS: Any = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_INNER_OPTIONS: Any = _OPTIONS | {"no_cpython_wrapper": True}


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a loop that Python calls. It lets other threads run, and divides as numpy does."""
    return _without_literals(njit(cache=True, **_OPTIONS)(function))


def inner_kernel(function: Callable[..., Any]) -> Any:
    """Compile a loop that only loops call: called from Python it ends the process (test/contracts looks)."""
    return _without_literals(njit(**_INNER_OPTIONS)(function))


def _without_literals(loop: Any) -> Any:
    """Let a loop that is called with 0 and with 1 be one that is called with whole numbers."""
    template_for = loop.get_call_template

    def get_call_template(arguments: Any, named: Any) -> Any:
        plain = tuple(types.unliteral(one) for one in arguments)
        return template_for(plain, {name: types.unliteral(one) for name, one in named.items()})

    loop.get_call_template = get_call_template
    return loop
