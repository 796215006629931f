"""Kernels that are only called by kernels get no machine code of their own: that makes compiling twice as fast.

Numba optimises every function fully and turns it into machine code before it is linked into its callers. All of ours
are inlined into an entry point, so what counts is the code of that. Inlined functions are only simplified here, as
LLVM's -O1 does: with less the entry point ends up 7 % slower, with more it takes longer and is no faster.

The classes of Numba that this changes are private. With versions of Numba that it was not tested with, compiling takes
twice as long and the kernels are 5 % slower; results are the same to the last bit.
"""

import numba

TESTED = ((0, 61), (0, 68))  # first and last version of Numba


def has_wrapper(module) -> bool:
    """Whether Python or C can call a function of this LLVM module."""
    return any("cpython" in each.name or "cfunc" in each.name for each in module.functions if not each.is_declaration)


def install() -> None:
    """Let Numba compile functions without a wrapper, which only compiled functions can call, for inlining alone."""
    if not TESTED[0] <= numba.version_info[:2] <= TESTED[1]:
        return
    from numba.core.codegen import JITCodeLibrary, JITCPUCodegen

    class Library(JITCodeLibrary):
        """The code of a function and of all that it calls."""

        inlined = False

        def _optimize_functions(self, module):
            if has_wrapper(module):
                super()._optimize_functions(module)
            else:
                module.data_layout = self._codegen._data_layout

        def finalize(self):
            if has_wrapper(self._final_module):
                super().finalize()
                return
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
        """Tell compiled code where its environment is, if it has machine code."""
        if self._engine.get_global_value_address(name):
            usual(self, name, environment)

    usual = JITCPUCodegen.set_env
    JITCPUCodegen._library_class, JITCPUCodegen.set_env = Library, set_env
