"""Numba's compiler, changed in two places where that makes kernels faster or saves most of the time
to compile them.

No machine code is made of kernels that are called only by other kernels, which saves two thirds of
the compile time. Numba optimises every function fully and compiles it to machine code before
linking it into its callers. Here all kernels are inlined into an entry point, whose machine code
alone is executed. Kernels are therefore only simplified, with LLVM's -O1 passes: with fewer passes
the entry point becomes 7 % slower; more take longer and make it no faster.

Indices of kernels are never negative, so none is counted from the end of an array. For every signed
index Numba compiles a test whether it is negative, and if so adds the array's length. This takes
two or three instructions, hundreds of times in a kernel, and registers: without it kernels are 1.1
to 1.4 times faster. No kernel of this package uses negative indices (tests/test_bounds.py runs them
with arrays that refuse these). Functions of other packages are compiled as usual.

This replaces private parts of Numba. With versions of Numba outside of TESTED, what is private is
left as it is: compiling then takes three times as long, kernels are 1.1 to 1.5 times slower, the
user is told, and results are the same. docs/compiled.md says what each replacement is worth, and
what to do when Numba changes.
"""

from functools import cache
from typing import Any

import numba
from llvmlite import ir
from llvmlite.binding import ModuleRef
from numba.core import compiler
from numba.core.cpu import CPUContext

# first and last version of Numba whose private parts are those used here
TESTED = ((0, 63), (0, 68))
IS_TESTED = TESTED[0] <= numba.version_info[:2] <= TESTED[1]  # the installed version is one of them
# prefix of this package's functions in LLVM; their wrappers for Python and C have other names
OURS = "_ZN9brownpipe"


def is_inlined(module: ModuleRef) -> bool:
    """Whether an LLVM module defines only functions of this package that can be called by compiled
    functions alone.
    """
    return all(
        function.name.startswith(OURS)
        for function in module.functions
        if not function.is_declaration
    )


def simplify_inlined() -> None:
    """Let Numba only simplify modules that `is_inlined`, and compile all others as usual."""
    from numba.core.codegen import JITCodeLibrary, JITCPUCodegen

    # Numba's data of functions without machine code yet, for print() etc.
    environments: dict[str, object] = {}

    class Library(JITCodeLibrary):
        """Numba's library of a function: its code and that of the functions it calls."""

        inlined = False

        def _optimize_functions(self, module: ModuleRef) -> None:
            if is_inlined(module):
                module.data_layout = self._codegen._data_layout
            else:
                super()._optimize_functions(module)

        def finalize(self) -> None:
            if is_inlined(self._final_module):
                self.simplify()
                return
            super().finalize()
            for name in list(environments):
                self._codegen.set_env(name, environments.pop(name))  # type: ignore[attr-defined]

        def simplify(self) -> None:
            self.inlined = True
            for library in dict.fromkeys(self._linking_libraries):
                self._reload_init.update(library._reload_init)
                self._final_module.link_in(library._get_module_for_linking(), preserve=True)
            passes, builder = self._codegen._module_pass_manager(
                opt=1, loop_vectorize=False, slp_vectorize=False
            )
            passes.run(self._final_module, builder)
            self._finalize_dynamic_globals()
            self._finalized = True

        def get_pointer_to_function(self, name: str) -> int:
            self._ensure_finalized()
            return 0 if self.inlined else super().get_pointer_to_function(name)

    def set_env(self: JITCPUCodegen, name: str, environment: object) -> None:
        """Set the environment of a function, now or as soon as there is machine code that refers to
        it.
        """
        if self._engine.get_global_value_address(name):
            usual(self, name, environment)
        else:
            environments[name] = environment

    usual = JITCPUCodegen.set_env
    JITCPUCodegen._library_class = Library
    JITCPUCodegen.set_env = set_env  # type: ignore[method-assign]  # replaced on purpose


class Compiler(compiler.Compiler):
    """Numba's compiler, which first sees to the indices."""

    def define_pipelines(self) -> list:
        take_indices()
        return super().define_pipelines()


@cache
def take_indices() -> None:
    """Let Numba take the indices in this package's functions as they are, from now on."""
    from numba.core.types import intp
    from numba.np import arrayobj  # 0.2 s of CPU, which a process with cached kernels saves

    def index(
        context: CPUContext,
        builder: ir.IRBuilder,
        kind: Any,
        value: ir.Value,
        size: ir.Value,
    ) -> ir.Value:
        if kind.signed and builder.function.name.startswith(OURS):
            return context.cast(builder, value, kind, intp)
        return usual(context, builder, kind, value, size)

    usual = arrayobj.fix_integer_index
    arrayobj.fix_integer_index = index  # replaced on purpose
