"""Kernels called only by other kernels get no machine code of their own, which saves a third of the compile time.

Numba optimises every function fully and turns it into machine code before it is linked into its callers. All kernels
are inlined into an entry point, and only the machine code of that is ever executed. The others are only simplified, as
LLVM's -O1 does: with less the entry point ends up 7 % slower, with more it takes longer and is no faster.

The classes of Numba that this changes are private. With versions of Numba that it was not tested with, compiling takes
half as long again and the kernels are 5 % slower; results are the same to the last bit.
"""

import numba

TESTED = ((0, 63), (0, 68))  # first and last version of Numba whose private classes are as used here
OURS = "_ZN9brownpipe"  # how the names of this package's functions begin in LLVM; wrappers for Python and C are others


def is_tested() -> bool:
    """Whether the private parts of this version of Numba are known."""
    return TESTED[0] <= numba.version_info[:2] <= TESTED[1]


def is_inlined(module) -> bool:
    """Whether an LLVM module defines nothing but functions of this package that only compiled functions can call."""
    return all(function.name.startswith(OURS) for function in module.functions if not function.is_declaration)


def install() -> None:
    """Let Numba compile this package's functions without a wrapper for inlining alone, and all others as usual."""
    if not is_tested():
        return
    from numba.core.codegen import JITCodeLibrary, JITCPUCodegen

    environments = {}  # of functions that have no machine code yet; what they print, for instance, needs one

    class Library(JITCodeLibrary):
        """The code of a function and of all that it calls."""

        inlined = False

        def _optimize_functions(self, module):
            if is_inlined(module):
                module.data_layout = self._codegen._data_layout
            else:
                super()._optimize_functions(module)

        def finalize(self):
            if is_inlined(self._final_module):
                self.simplify()
                return
            super().finalize()
            for name in list(environments):
                self._codegen.set_env(name, environments.pop(name))

        def simplify(self):
            self.inlined = True
            for library in dict.fromkeys(self._linking_libraries):
                self._reload_init.update(library._reload_init)
                self._final_module.link_in(library._get_module_for_linking(), preserve=True)
            passes, builder = self._codegen._module_pass_manager(opt=1, loop_vectorize=False, slp_vectorize=False)
            passes.run(self._final_module, builder)
            self._finalize_dynamic_globals()
            self._finalized = True

        def get_pointer_to_function(self, name):
            self._ensure_finalized()
            return 0 if self.inlined else super().get_pointer_to_function(name)

    def set_env(self, name, environment):
        """Tell machine code where its environment is, now or as soon as there is any."""
        if self._engine.get_global_value_address(name):
            usual(self, name, environment)
        else:
            environments[name] = environment

    usual = JITCPUCodegen.set_env
    JITCPUCodegen._library_class, JITCPUCodegen.set_env = Library, set_env
