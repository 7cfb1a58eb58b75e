"""How numba's compiler takes a loop: without what loops do not have."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, cached_property
from typing import Any

from numba.core import cgutils, postproc
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import (
    AnnotateTypes,
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.untyped_passes import FixupArgs, ReconstructSSA, RewriteDynamicRaises, TranslateByteCode


@contextmanager
def meanwhile(thing: Any, name: str, value: Any) -> Iterator[None]:
    """Give a thing another attribute for a while."""
    before = getattr(thing, name)
    setattr(thing, name, value)
    try:
        yield
    finally:
        setattr(thing, name, before)


class LoopLower(Lower):
    """Numba's writer of functions, for names most of which stand for nothing that has to be given back."""

    def alloca_lltype(self, name: str, lltype: Any, datamodel: Any = None) -> Any:
        """Take a place on the stack; there are no debuggers to tell of it."""
        return cgutils.alloca_once(self.builder, lltype, name=name)

    def storevar(self, value: Any, name: str, argidx: int | None = None) -> None:
        """Give a name a value, and give back what it stood for."""
        if self._holds_memory(self.typeof(name)):
            super().storevar(value, name, argidx)
            return
        self._alloca_var(name, self.typeof(name))
        if name in self._singly_assigned_vars:
            self._blk_local_varmap[name] = value
        else:
            self.builder.store(value, self.getvar(name))

    def delvar(self, name: str) -> None:
        """Give back what a name stands for that is not used any more."""
        if self._holds_memory(self.typeof(name)):
            super().delvar(name)

    def incref(self, typ: Any, val: Any) -> None:
        """Count one more name, of what has memory."""
        if self._holds_memory(typ):
            super().incref(typ, val)

    def create_cfunc_wrapper(self) -> None:
        """Leave out the way in from C, which nobody takes."""

    @cached_property
    def _holds_memory(self) -> Any:
        models = self.context.data_model_manager
        return cache(lambda kind: models[kind].contains_nrt_meminfo())


class _Lifetimes(postproc.PostProcessor):
    """Stands in for how numba tells, after each pass, where variables live: the last one alone asks."""

    def run(self, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        if emit_dels:
            super().run(emit_dels, extend_lifetimes)


def _without_lifetimes(one: Any) -> Any:
    class Pass(one):
        def run_pass(self, state: Any) -> Any:
            with meanwhile(postproc, "PostProcessor", _Lifetimes):
                return super().run_pass(state)

    return register_pass(mutates_CFG=True, analysis_only=False)(Pass)


#: Left out are those for functions within functions, comprehensions, `with`, `literally`, `inline="always"`.
_PASSES = (
    TranslateByteCode,
    FixupArgs,
    RewriteDynamicRaises,
    _without_lifetimes(ReconstructSSA),
    NopythonTypeInference,
    _without_lifetimes(PreLowerStripPhis),
    IRLegalization,
    AnnotateTypes,
    NativeLowering,
    NoPythonBackend,
)


class LoopCompiler(Compiler):
    """Numba's compiler, with the passes that loops need."""

    def define_pipelines(self) -> list[PassManager]:
        """Return the one way to compile."""
        passes = PassManager("loop")
        for one in _PASSES:
            passes.add_pass(one, one.__name__)
        passes.finalize()
        return [passes]
