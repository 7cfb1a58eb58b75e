"""
How numba's compiler takes a loop: without what loops do not have, or their caller holds.

Numba counts a reference for each name that an array has, and those of parts of it, with instructions that
wait for the other cores. Its own look at what cancels out (`LLVM_REFPRUNE_PASS`) gives up where a loop has
several ways out or an array several names: two of three counts stay, some in the innermost loops.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache, cached_property
from typing import Any

from numba.core import cgutils, ir, postproc, types
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
    """
    Numba's writer of functions, for variables that hold nothing, or what was handed in.

    An array that was handed in, and views of it, live as long as the function runs: names that never stand
    for anything else are not counted, neither where they are given nor where they end.
    """

    def alloca_lltype(self, name: str, lltype: Any, datamodel: Any = None) -> Any:
        """Take a place on the stack; there are no debuggers to tell of it."""
        return cgutils.alloca_once(self.builder, lltype, name=name)

    def lower_assign(self, ty: Any, inst: Any) -> Any:
        """Write what a name is given."""
        if self._is_counted(inst.target.name):
            return super().lower_assign(ty, inst)
        with ExitStack() as without:
            if self._holds_memory(ty):
                for count in ("incref", "decref"):
                    without.enter_context(meanwhile(self.context.nrt, count, lambda *_: None))
            return super().lower_assign(ty, inst)

    def storevar(self, value: Any, name: str, argidx: int | None = None) -> None:
        """Give a name a value, and give back what it stood for."""
        if self._is_counted(name):
            super().storevar(value, name, argidx)
            return
        self._alloca_var(name, self.typeof(name))
        if name in self._singly_assigned_vars:
            self._blk_local_varmap[name] = value
        else:
            self.builder.store(value, self.getvar(name))

    def delvar(self, name: str) -> None:
        """Give back what a name stands for that is not used any more."""
        if self._is_counted(name):
            super().delvar(name)

    def incref(self, typ: Any, val: Any) -> None:
        """Count one more name, of what has memory."""
        if self._holds_memory(typ):
            super().incref(typ, val)

    def create_cfunc_wrapper(self) -> None:
        """Leave out the way in from C, which nobody takes."""

    def _is_counted(self, name: str) -> bool:
        return name not in self._borrowed and self._holds_memory(self.typeof(name))

    @cached_property
    def _holds_memory(self) -> Any:
        models = self.context.data_model_manager
        return cache(lambda kind: models[kind].contains_nrt_meminfo())

    @cached_property
    def _borrowed(self) -> set[str]:
        """Names that stand for what was handed in, whole or in part, and for nothing else."""
        given = defaultdict(list)
        returned = set()
        for block in self.func_ir.blocks.values():
            for instruction in block.body:
                if isinstance(instruction, ir.Assign):
                    given[instruction.target.name].append(instruction.value)
                elif isinstance(instruction, ir.Return):
                    returned.add(instruction.value.name)
        borrowed = {name for name in given if self._holds_memory(self.typeof(name))} - returned
        n_before = -1
        while n_before != len(borrowed):
            n_before = len(borrowed)
            borrowed = {name for name in borrowed if all(self._borrows(one, borrowed) for one in given[name])}
        return borrowed

    def _borrows(self, value: Any, borrowed: set[str]) -> bool:
        """Whether what a name is given is handed in, or a view of what a borrowed name stands for."""
        if isinstance(value, ir.Arg):
            return not isinstance(self.typeof(f"arg.{value.name}"), types.Omitted)
        if isinstance(value, ir.Var):
            return value.name in borrowed
        if not isinstance(value, ir.Expr) or value.op not in ("getitem", "static_getitem"):
            return False
        of = self.typeof(value.value.name)
        return value.value.name in borrowed and isinstance(of, types.Array) and self._is_basic(value)

    def _is_basic(self, part: Any) -> bool:
        """Whether a part of an array is a view: what numbers and slices ask for, not lists of places."""
        variable = part.index if part.op == "getitem" else part.index_var
        if variable is None:
            return False
        kind = self.typeof(variable.name)
        kinds = getattr(kind, "types", [kind])  # of a tuple
        return all(isinstance(one, (types.Integer, types.SliceType)) for one in kinds)


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
