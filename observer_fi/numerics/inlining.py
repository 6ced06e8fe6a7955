"""Functions that exist only inside the kernels that call them.

numba makes machine code of every function it meets: it optimises the body together with all it calls, wraps it for calls
from Python, and does so again one level up. An equation that stands in ten kernels, six levels deep, was compiled dozens
of times and most of that thrown away: two thirds of the first run. Here a function is typed and written as LLVM, and
optimised only where it ends up. docs/rows.md says which of numba's internals this rests on.
"""

from collections.abc import Callable
from typing import Any

from numba.core import compiler
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering


class _Ingredients(JITCodeLibrary):
    """LLVM code that goes into other libraries and never becomes machine code by itself."""

    def _optimize_final_module(self) -> None:
        """The library that takes it optimises."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


class _NoEntry:
    """Stands for the address that a function without machine code does not have: numba looks functions up by it."""


@register_pass(mutates_CFG=True, analysis_only=False)
class _LowerOnly(NativeLowering):
    """Lowering to LLVM without what Python needs for a call, and without machine code."""

    _name = "observer_fi_lower_only"

    def run_pass(self, state: Any) -> bool:
        state.library = _Ingredients(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_cpython_wrapper = state.flags.no_cfunc_wrapper = state.flags.no_compile = True
        super().run_pass(state)
        entry = _NoEntry()
        state["cr"] = state["cr"]._replace(cfunc=entry)
        state.targetctx.insert_user_function(entry, state["cr"].fndesc, [state.library])
        return True


class _LoweringCompiler(compiler.CompilerBase):
    """numba's compiler with `_LowerOnly` for its last step."""

    def define_pipelines(self) -> list[Any]:
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.passes = [
            (_LowerOnly if each is NativeLowering else each, text) for each, text in passes.passes
        ]
        passes._finalized = False
        passes.finalize()
        return [passes]


class InlinedFunction(CPUDispatcher):
    """A function for kernels; called from Python it is compiled once more, by itself."""

    def __init__(
        self,
        function: Callable[..., Any],
        compiled: Callable[[Callable[..., Any]], Callable[..., Any]],
        options: dict[str, Any],
    ) -> None:
        super().__init__(function, targetoptions=options, pipeline_class=_LoweringCompiler)
        self.compiled = compiled
        self.alone: dict[bool, Any] = {}  # by whether it is kept on disk

    def __call__(self, *args: Any) -> Any:
        # What is made for another function is not kept: the file would name an object of this process, and the next process
        # that adds to that file could not write it again.
        kept = not any(isinstance(arg, CPUDispatcher) for arg in args)
        if kept not in self.alone:
            self.alone[kept] = self.compiled(self.py_func)
            if not kept:
                self.alone[kept]._cache = NullCache()
        return self.alone[kept](*args)

    def add_overload(self, result: Any) -> None:
        """Remember a lowered form; there is none that Python could call."""
        self.overloads[tuple(result.signature.args)] = result
