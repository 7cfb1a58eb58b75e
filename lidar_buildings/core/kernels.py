"""
How loops are compiled: `kernel` for those that Python calls, `inner_kernel` for those that only kernels call.

Numba takes some 0.1 s of a processor for each. Both leave out what is never used: the way in from C, copies
for each literal number that a loop passes on, what loops do not have (see `loop_compiler`), and for inner
ones, as for numba's own functions, the way in from Python, machine code and a file of their own, as the files
of their callers hold them. Which of its functions a call means, numba looks up once. What was compiled before
is loaded as machine code alone: what the compiler would need is read when it is asked for. References to
arrays that are handed in are not counted (see `reference_counts`).
"""

from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar

from numba import njit, types
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary, ll
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.typed_passes import NativeLowering

from lidar_buildings.core.loop_compiler import LoopCompiler, LoopLower, meanwhile
from lidar_buildings.core.reference_counts import without_borrowed

#: What numba rewrites are formulas of whole arrays, parts of tuples, errors with a message, `is None`: loops
#: do without (such a part or error does not compile, such a formula takes longer to).
_OPTIONS: Any = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, "no_rewrites": True}
_INNER_OPTIONS: Any = _OPTIONS | {"no_cpython_wrapper": True}


class _WholeLibrary(JITCodeLibrary):
    """A loop with all that it calls: tidied one by one, made fast once, as a whole."""

    packs = False

    def add_llvm_module(self, ll_module: Any) -> None:
        """Take a loop as numba has written it: with plain values, short enough to be put into callers."""
        ll_module.data_layout = self._codegen._data_layout
        passes = ll.create_new_module_pass_manager()
        passes.add_sroa_pass()
        passes.add_instruction_combine_pass()
        passes.add_simplify_cfg_pass()
        passes.run(ll_module, self._codegen._pass_builder())
        tidied = ll.parse_assembly(without_borrowed(str(ll_module)))
        tidied.name = ll_module.name
        super().add_llvm_module(tidied)

    def _optimize_functions(self, ll_module: Any) -> None:
        """Leave each of its functions to the look at the whole."""
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager(slp_vectorize=self.packs)
        passes.run(self._final_module, builder)


class _InnerLibrary(_WholeLibrary):
    """What LLVM knows of an inner loop, or of what numba brings along: enough to be put into the callers."""

    @property
    def codegen(self) -> Any:
        """Stands in for what would be told where the machine code lies."""
        return self

    def set_env(self, name: str, env: object) -> None:
        """There is no machine code to be told of its globals."""

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        """Leave it to the callers."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _Signatures:
    """Stands in for how numba finds the signature of a call: once for a function and kinds of arguments."""

    _found: ClassVar[dict[Any, Any]] = {}

    def __init__(self, typing: Any) -> None:
        self._find = partial(type(typing).resolve_function_type, typing)

    def __call__(self, function: Any, arguments: Any, named: Any) -> Any:
        """Return the signature; loops, which such a call compiles, are asked each time."""
        if isinstance(function, types.Dispatcher):
            return self._find(function, arguments, named)
        key = function, tuple(arguments), tuple(dict(named).items())
        found = self._found.get(key) or self._find(function, arguments, named)
        if found is not None:
            self._found[key] = found
        return found


class _WholeCompiler(LoopCompiler):
    """What is compiled on the way, which Python never calls, becomes an inner library."""

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        generator, typing = self.state.targetctx.codegen(), self.state.typingctx
        with (
            meanwhile(generator, "_library_class", _InnerLibrary),
            meanwhile(typing, "resolve_function_type", _Signatures(typing)),
            meanwhile(NativeLowering, "lowering_class", LoopLower),
            meanwhile(ll.ffi.lib._lock, "_cblist", []),
        ):
            self.state.library = _WholeLibrary(generator, function.__qualname__)
            self.state.library.packs = hasattr(function, "packs")
            self.state.library.enable_object_caching()
            return super().compile_extra(function)


class _LoadedLibrary(JITCodeLibrary):
    """Machine code from a file; what LLVM knows of it is parsed if a loop that is compiled calls it."""

    _bitcode: bytes

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[str, str, tuple[bytes, bytes]]) -> Any:
        name, _, (machine_code, bitcode) = state
        self = cls(codegen, name)
        self._bitcode = bitcode
        self.enable_object_caching()
        self._set_compiled_object(machine_code)
        self._finalize_final_module()
        return self

    def get_pointer_to_function(self, name: str) -> int:
        address: int = self._codegen._engine.get_function_address(name)
        return address

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None:
            self._shared_module = ll.parse_bitcode(self._bitcode)
        return self._shared_module


class _Loading:
    """Stands in for numba's target, and its code generator, while a compiled loop is loaded."""

    def __init__(self, target: Any) -> None:
        self._target = target

    def __getattr__(self, name: str) -> Any:
        return getattr(self._target, name)

    def codegen(self) -> Any:
        """Return what makes libraries of what files hold."""
        return self

    def unserialize_library(self, state: Any) -> Any:
        return _LoadedLibrary._unserialize(self._target.codegen(), state)


class _LoadedResult(CompileResultCacheImpl):
    """How numba's files are read."""

    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> CompileResult:
        result = CompileResult._rebuild(_Loading(target_context), *payload)
        return result._replace(target_context=target_context)


class _Files(FunctionCache):
    """Numba's files, read without what only the compiler needs to know of all that numba can do."""

    _impl_class = _LoadedResult

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)  # what compiled loops allocate memory with
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a loop that Python calls. It lets other threads run, and divides as numpy does."""
    loop = njit(cache=True, pipeline_class=_WholeCompiler, **_OPTIONS)(function)
    loop._cache = _Files(function)
    return _without_literals(loop)


def inner_kernel(function: Callable[..., Any]) -> Any:
    """Compile a loop that only loops call: called from Python it ends the process (test/contracts looks)."""
    return _without_literals(njit(pipeline_class=LoopCompiler, **_INNER_OPTIONS)(function))


def packed(function: Callable[..., Any]) -> Callable[..., Any]:
    """
    Let a loop do sums beside one another in one instruction (SLP), before `kernel` takes it.

    Not for all: LLVM has got some loops wrong that way, which is why numba leaves it out. Tests compare what
    such a loop finds with numpy's results.
    """
    function.packs = True  # type: ignore[attr-defined]
    return function


def inlined(loop: Any) -> Any:
    """Put a short loop into each of its callers whole, so that they can be made wide (SIMD)."""
    loop.targetoptions["forceinline"] = True
    return loop


def _without_literals(loop: Any) -> Any:
    """Let a loop that is called with 0, or with 32 bits, be one that is called with whole numbers."""
    template_for = loop.get_call_template

    def get_call_template(arguments: Any, named: Any) -> Any:
        plain = tuple(_plain(one) for one in arguments)
        return template_for(plain, {name: _plain(one) for name, one in named.items()})

    loop.get_call_template = get_call_template
    return loop


def _plain(kind: Any) -> Any:
    kind = types.unliteral(kind)
    return types.int64 if kind in types.signed_domain else kind
