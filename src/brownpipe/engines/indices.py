"""Make kernels faster: their indices are never negative, so none is counted from the end of an array.

Of every signed index Numba asks whether it is negative, and if so adds the array's length: two or three instructions,
of which a kernel has hundreds, and less room in registers. No kernel of this package uses negative indices
(tests/test_bounds.py runs them with arrays that refuse these). Functions of other packages are compiled as usual.

This replaces a private function of Numba. With versions of Numba that `inlining` was not tested with it is left as it
is; the kernels are slower then, and results are the same.
"""

from functools import cache
from typing import Any

from brownpipe.engines.inlining import OURS


@cache
def install() -> None:
    """Let Numba take the indices in this package's functions as they are, from now on."""
    from numba.core.types import intp
    from numba.np import arrayobj  # 0.2 s of CPU, which a process with cached kernels saves

    def index(context: Any, builder: Any, kind: Any, value: Any, size: Any) -> Any:
        if kind.signed and builder.function.name.startswith(OURS):
            return context.cast(builder, value, kind, intp)
        return usual(context, builder, kind, value, size)

    usual = arrayobj.fix_integer_index
    arrayobj.fix_integer_index = index  # replaced on purpose
