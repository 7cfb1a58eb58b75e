"""
How loops are compiled: `kernel` for those that Python calls, `inner_kernel` for those that only kernels call.

Numba takes some 0.3 s of a processor for each. Both leave out what is never used: the way in from C, copies
for each literal number that a loop passes on, and for inner ones the way in from Python, machine code and a
file of their own, as the files of their callers hold them.
"""

from collections.abc import Callable
from typing import Any

from numba import njit, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

_OPTIONS: Any = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


class _InnerLibrary(JITCodeLibrary):
    """What LLVM knows of an inner loop: enough to be put into its callers."""

    @property
    def codegen(self) -> Any:
        """Stands in for what would be told where the machine code lies."""
        return self

    def set_env(self, name: str, env: object) -> None:
        """There is no machine code to be told of its globals."""

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _InnerCompiler(Compiler):
    """Numba's compiler with another place for the result."""

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        self.state.library = _InnerLibrary(self.state.targetctx.codegen(), function.__qualname__)
        return super().compile_extra(function)


_INNER_OPTIONS: Any = _OPTIONS | {"no_cpython_wrapper": True, "pipeline_class": _InnerCompiler}


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
