"""Kernels from the folder where they are kept, loaded without what only compiling needs.

numba imports its whole standard library and reads the LLVM code of a kernel before it hands out machine code that was
there all along: 0.3 s of a first call. Here both wait until a kernel is compiled, or is taken into another one.
docs/rows.md says which of numba's internals this rests on.
"""

from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.runtime.nrt import rtsys


class _KeptLibrary(JITCodeLibrary):
    """Machine code of a kernel; its LLVM code is read where another kernel takes it in."""

    _bitcode = b""

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> "_KeptLibrary":
        name, _, (machine_code, bitcode) = state
        self = cls(codegen, name)
        self.enable_object_caching()
        self._set_compiled_object(machine_code)
        self._bitcode = bitcode
        self._finalize_final_module()
        return self

    def get_pointer_to_function(self, name: str) -> int:
        """Address of a function of the kernel, which numba would first look up in its LLVM code."""
        return int(self._codegen._engine.get_function_address(name))

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None and self._bitcode:
            self._shared_module = llvm.parse_bitcode(self._bitcode)
        return super()._get_module_for_linking()


class KernelCache(FunctionCache):
    """The cache of one kernel. counted: whether it counts references, which numba's runtime must be there for."""

    def __init__(self, function: Callable[..., Any], counted: bool) -> None:
        super().__init__(function)
        self.counted = counted

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The kernel for a signature, None where it was never compiled. numba holds the compiler's lock around it."""
        if self.counted:
            rtsys.initialize(target_context)
        codegen = target_context.codegen()
        usual, codegen._library_class = codegen._library_class, _KeptLibrary
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        finally:
            codegen._library_class = usual
