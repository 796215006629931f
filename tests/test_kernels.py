"""Kernels are compiled once, whoever needs them, and correctly."""

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest

from brownpipe.engines import compiler, kernels
from brownpipe.engines.records import by_reference, local_copy

HERE = Path(__file__).parent
NOTE = HERE.parent / "config" / "scenes" / "harrison2020.yaml"


def test_a_prefetch_is_compiled_to_one():
    """A missing prefetch changes no result, so look at the LLVM code."""

    @numba.njit
    def ask(array, index):
        kernels.prefetch(array, index)

    ask(np.zeros(4, np.uint32), 2)
    (compiled,) = ask.inspect_llvm().values()
    assert "call void @llvm.prefetch" in compiled


PLACED = """
import sys
from brownpipe.engines import compiler
if sys.argv[1] == "usual":
    compiler.TESTED = ((0, 0), (0, 0))
from numba.core.codegen import JITCPUCodegen
from brownpipe.scene import read_scene
from brownpipe.engines.initial_state import draw
print(JITCPUCodegen._library_class.__module__, draw(read_scene(sys.argv[2]), 7).position.tobytes().hex())
"""


@pytest.mark.slow
def test_with_a_numba_that_was_not_tested_kernels_are_compiled_as_usual_to_the_same_bits(tmp_path):
    results = [
        subprocess.run(
            [sys.executable, "-c", PLACED, which, str(NOTE)],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / which)},
            capture_output=True,
            text=True,
            check=True,
            timeout=300,
        ).stdout.split()
        for which in ("inlined", "usual")
    ]
    tested = compiler.is_tested()
    expected = "brownpipe.engines.compiler" if tested else "numba.core.codegen"
    assert [module for module, _ in results] == [expected, "numba.core.codegen"]
    assert results[0][1] == results[1][1] and len(results[0][1]) > 1000


@by_reference
class Inner(NamedTuple):
    number: int
    values: object


@by_reference
class Outer(NamedTuple):
    scale: float
    inner: Inner
    missing: object
    values: object


@kernels.kernel
def part(missing, outer, k):
    """A kernel in which what is None is left out."""
    if missing is None:
        return outer.scale * outer.inner.values[k] + outer.inner.number
    return missing.no_such_field


@kernels.entry_point
def work(outer):
    """Reads scalars, arrays and nested records; writes through the arrays of both."""
    outer = local_copy(outer)
    total = 0.0
    for k in range(len(outer.values)):
        outer.values[k] = part(outer.missing, outer, k)
        outer.inner.values[k] += 1.0
        total += outer.values[k]
    return total


def test_a_record_is_passed_by_reference():
    record = Outer(2.0, Inner(3, np.arange(4.0)), None, np.zeros(4))
    assert work(record) == 2.0 * (0 + 1 + 2 + 3) + 4 * 3
    assert record.values.tolist() == [3.0, 5.0, 7.0, 9.0] and record.inner.values.tolist() == [1.0, 2.0, 3.0, 4.0]


def test_records_with_other_fields_are_other_types():
    one = numba.typeof(Inner(3, np.arange(4.0)))
    assert one == numba.typeof(Inner(5, np.zeros(7))) and one != numba.typeof(Inner(3, np.arange(4)))
    assert one.name != numba.typeof(Inner(3, np.arange(4))).name != numba.typeof(Inner(3.0, np.arange(4))).name


def test_a_kernel_called_from_python_is_python():
    assert part(None, Outer(2.0, Inner(3, [1, 2]), None, None), 1) == 7.0


@kernels.kernel
def says(number):
    """What prints needs an environment."""
    print("kernel", number)
    return number + 1


def test_other_peoples_compiled_functions_work_as_ever(capfd):
    """Ufuncs, functions that only compiled functions can call, kernels that print, and indices from the end."""
    compiler.take_indices()

    @numba.vectorize(["float64(float64)"])
    def twice(x):
        return 2.0 * x

    @numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True)
    def inner(n):
        return n if n < 2 else inner(n - 1) + inner(n - 2)

    @numba.njit
    def outer(n):
        return inner(n) + says(n)

    @numba.njit
    def last_but(array, n):
        return array[-1 - n]

    assert twice(np.arange(3.0)).tolist() == [0.0, 2.0, 4.0]
    assert outer(10) == 55 + 11
    assert last_but(np.arange(5.0), 1) == 3.0
    assert capfd.readouterr().out == "kernel 10\n"


def test_a_record_leaves_no_references_to_its_arrays():
    """Neither with reference counts nor without."""

    @numba.njit
    def counted(outer):
        return outer.values[0] + outer.inner.values[0]

    record = Outer(2.0, Inner(3, np.arange(4.0)), None, np.zeros(4))
    for function in (work, counted):
        function(record)
        before = [sys.getrefcount(array) for array in (record.values, record.inner.values)]
        for _ in range(10):
            function(record)
        assert [sys.getrefcount(array) for array in (record.values, record.inner.values)] == before
