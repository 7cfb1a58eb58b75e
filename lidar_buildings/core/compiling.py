"""
How numba compiles the package's loops: in less time than by itself, to as fast code.

Numba makes machine code of each loop, and of each function of numpy that a loop calls, and optimises it
again in each loop that calls it. But nobody runs an inner loop: it becomes part of the loops that call it.
Here only what Python calls is optimised as a whole and made into machine code, once, with all that it calls.
Passes for what no loop has are left out, and the types of a call that were found out once are kept.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags
from numba.core.environment import lookup_environment
from numba.core.typing import Context

#: For closures, comprehensions, arguments that may be None, messages put together, and Python's own objects.
_UNUSED_PASSES = {
    "WithLifting",
    "InlineClosureLikes",
    "RewriteSemanticConstants",
    "DeadBranchPrune",
    "RewriteDynamicRaises",
    "MakeFunctionToJitFunction",
    "InlineInlinables",
    "FindLiterallyCalls",
    "LiteralUnroll",
    "LiteralPropagationSubPipelinePass",
}


class LoopCompiler(Compiler):
    """Numba's compiler for loops that numbers and arrays go through."""

    def __init__(self, typingctx: Any, targetctx: Any, library: Any, args: Any, *others: Any) -> None:
        return_type, flags, variables = others
        super().__init__(
            _known_types(typingctx), targetctx, library, args, return_type, _LoopFlags(flags), variables
        )

    def define_pipelines(self) -> Any:
        """Return numba's steps without those that no loop needs."""
        pipelines = super().define_pipelines()
        for one in pipelines:
            one.passes = [step for step in one.passes if step[0].__name__ not in _UNUSED_PASSES]
            one._finalized = False
            one.finalize()
        return pipelines

    def compile_extra(self, func: Any) -> Any:
        """Compile a function, with all that it calls, into libraries whose machine code waits."""
        codegen = self.state.targetctx.codegen()
        outer = codegen._library_class
        codegen._library_class = LoopLibrary
        try:
            return super().compile_extra(func)
        finally:
            codegen._library_class = outer


class LoopLibrary(JITCodeLibrary):
    """The code of a loop, optimised and made into machine code when somebody asks where it starts."""

    _is_made = False

    def get_pointer_to_function(self, name: str) -> int:
        """Return where a function starts, 0 if the loop has none of this name: no way in from Python."""
        self._ensure_finalized()
        if not self._is_made and name in {one.name for one in self.get_defined_functions()}:
            super()._optimize_final_module()
            self._make()
            for one in self._final_module.global_variables:
                environment = lookup_environment(one.name)
                if environment is not None:
                    self.codegen.set_env(one.name, environment)
        return int(super().get_pointer_to_function(name)) if self._is_made else 0

    @property
    def codegen(self) -> Any:
        """Return who sets variables of the machine code: without any, this library, which sets none."""
        return self._codegen if self._is_made else self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: the loops that have this one inside set it."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        if getattr(self, "_compiled_object", None) is None:
            self._finalized = True
        else:
            self._make()  # read from a file, while a loop that calls it is compiled

    def _make(self) -> None:
        self._is_made = True
        super()._finalize_final_module()


class _LoopFlags(Flags):
    """Options of a loop, which do not change any more: numba compares them at each call that it looks at."""

    __slots__ = ("_hash", "_known")

    def __init__(self, flags: Any) -> None:
        super().__init__(flags)
        self._known = super().values()
        self._hash = super().__hash__()

    def values(self) -> Any:
        return self._known

    def copy(self) -> Any:
        """Return what functions of numpy inherit: the same for inner loops, or they were compiled twice."""
        return _INHERITED.setdefault(str(self.error_model), self)

    def __eq__(self, other: object) -> bool:
        return self is other or bool(super().__eq__(other))

    def __hash__(self) -> int:
        return self._hash


class _KnownTypes(Context):
    """Numba's types of calls, each found out once."""

    def __init__(self, context: Any) -> None:
        self.__dict__.update(vars(context))
        self._context = context
        self._known: dict[Any, Any] = {}

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """Return the types that a call takes and returns."""
        if kws or isinstance(func, (str, types.Dispatcher, types.RecursiveCall)):
            return self._context.resolve_function_type(func, args, kws)
        found = self._known.get((func, args))
        if found is None:
            found = self._context.resolve_function_type(func, args, kws)
            if found is not None and found.return_type.is_precise():
                self._known[func, args] = found
        return found

    def refresh(self) -> None:
        """Let numba look for new types and functions."""
        self._context.refresh()


#: By how a loop divides by zero.
_INHERITED: dict[str, _LoopFlags] = {}


@cache
def _known_types(context: Any) -> _KnownTypes:
    return _KnownTypes(context)
