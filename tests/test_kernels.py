"""Kernels are compiled once, whoever needs them, and correctly."""

import os
import re
import signal
import subprocess
import sys
import time
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.compiler import Compiler, DefaultPassBuilder, Flags

from brownpipe.engines import indices, inlining, kernel_cache, kernels, passes
from brownpipe.engines.compiled import KernelCall
from brownpipe.engines.compiling import compile_all, one_compiler
from brownpipe.engines.records import by_reference, local_copy

HERE = Path(__file__).parent
NOTE = HERE.parent / "config" / "scenes" / "harrison2020.yaml"


def at_once(function, *arguments):
    """Call a function with each argument in a forked process of its own, all at the same time; return the results."""
    with get_context("fork").Pool(len(arguments)) as pool:
        return pool.map_async(function, arguments, chunksize=1).get(timeout=120)


def hold(file):
    """Take the lock of compiling for a while; return when that began and ended."""
    with one_compiler(file, "work"):
        began = time.monotonic()
        time.sleep(0.2)
        return began, time.monotonic()


@pytest.mark.slow
def test_one_compiler_at_a_time(tmp_path):
    times = sorted(at_once(hold, *[tmp_path / "code.nbc"] * 3))
    assert len(times) == 3
    assert all(end <= begin for (_, end), (begin, _) in pairwise(times))


def compile_and_call(given):
    """Compile `work` for a type, unless its machine code is in the folder; return how often, and what it calculates."""
    folder, kind = given
    made, told, write = kernels.entry_point(work.py_func), [], kernel_cache.write

    def write_slowly(*file):
        time.sleep(0.5)
        write(*file)

    made._cache = kernel_cache.DiskCache(folder, work.py_func)
    record = Outer(2.0, Inner(3, np.arange(4, dtype=kind)), None, np.zeros(4, kind))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel_cache, "write", write_slowly)
        patch.setattr(kernel_cache, "on_compile", [told.append])
        compile_all([KernelCall(made, (record._replace(values=record.values[:0]),), 1.0)])
    return len(told), made(record), record.values.tolist()


@pytest.mark.slow
def test_several_processes_compile_for_other_types_at_once(tmp_path):
    """And each finds its own machine code afterwards, not that of another one, though the disk is slow."""
    given = [(tmp_path / "code", kind) for kind in ("float64", "int64")]
    assert at_once(compile_and_call, *given) == [(1, 24, [3, 5, 7, 9])] * 2
    assert at_once(compile_and_call, *given) == [(0, 24, [3, 5, 7, 9])] * 2


def test_a_prefetch_is_compiled_to_one():
    """A missing prefetch changes no result, so look at the LLVM code."""

    @numba.njit
    def ask(array, index):
        kernels.prefetch(array, index)

    ask(np.zeros(4, np.uint32), 2)
    (compiled,) = ask.inspect_llvm().values()
    assert "call void @llvm.prefetch" in compiled


INTERRUPTED = """
from brownpipe.engines import kernel_cache
from brownpipe.engines.exact import run as exact
from brownpipe.scene import read_scene
kernel_cache.on_compile.append(lambda line: print(line, flush=True))
exact.prepare_scene(read_scene(SCENE))
print("compiled")
"""


@pytest.mark.slow
def test_ctrl_c_ends_the_compiling_of_an_engine(tmp_path):
    """Within a call of LLVM, the longest of which takes a second on a quiet machine; nothing half-written is left."""
    code = INTERRUPTED.replace("SCENE", repr(str(NOTE)))
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline().startswith("compiling")
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=20)
    assert process.returncode != 0 and "KeyboardInterrupt" in error and "compiled" not in out
    assert not [path for path in tmp_path.rglob("*") if path.suffix in (".nbi", ".nbc", ".part")]


PLACED = """
import sys
from brownpipe.engines import inlining
if sys.argv[1] == "usual":
    inlining.TESTED = ((0, 0), (0, 0))
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
    tested = inlining.TESTED[0] <= numba.version_info[:2] <= inlining.TESTED[1]
    expected = "brownpipe.engines.inlining" if tested else "numba.core.codegen"
    assert [module for module, _ in results] == [expected, "numba.core.codegen"]
    assert results[0][1] == results[1][1] and len(results[0][1]) > 1000


LINEAR_ALGEBRA = """
import sys
import numba
import numpy as np

@numba.njit
def algebra(a, b):
    return np.dot(a, b), np.linalg.cholesky(a)

def own():
    product, root = algebra(np.array([[4.0, 2.0], [2.0, 5.0]]), np.array([5.0, 7.0]))
    assert product.tolist() == [34.0, 45.0] and root.tolist() == [[2.0, 0.0], [1.0, 2.0]]

def brownpipe():
    from brownpipe.engines import inlining
    if sys.argv[2] == "untested":
        inlining.TESTED = ((0, 0), (0, 0))
    from brownpipe.scene import read_scene
    from brownpipe.engines.initial_state import draw
    draw(read_scene(sys.argv[3]), 7)

for use in sys.argv[1].split(","):
    globals()[use]()
    print(use, "scipy.linalg" in sys.modules)
from numba.np import arraymath, linalg
print(arraymath._HAVE_BLAS, arraymath.ensure_blas is linalg.ensure_blas, linalg.ensure_blas.__name__)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("uses", "version", "imported"),
    [
        ("brownpipe,own,brownpipe", "tested", (False, True, True)),
        ("own,brownpipe,own", "tested", (True, True, True)),
        ("brownpipe", "untested", (True,)),
    ],
)
def test_blas_is_imported_for_the_first_function_that_calls_it(uses, version, imported):
    """And is there for other people's compiled functions, before and after kernels of this package were called."""
    if version == "tested" and not inlining.is_tested():
        pytest.skip("this version of Numba is left as it is")
    printed = subprocess.run(
        [sys.executable, "-c", LINEAR_ALGEBRA, uses, version, str(NOTE)],
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    ).stdout.splitlines()
    assert printed[:-1] == [f"{use} {known}" for use, known in zip(uses.split(","), imported, strict=True)]
    assert printed[-1] == "True True ensure_blas"


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


def machine_code(options):
    """The assembly of `work`, compiled with these options, without its names, which number the functions."""
    record = Outer(2.0, Inner(3, np.arange(4.0)), None, np.zeros(4))
    compiled = numba.njit(**options)(work.py_func)
    compiled(record)
    (text,) = compiled.inspect_asm().values()
    return re.sub(r"\b_ZN\S+|\d{6,}", "", text).splitlines()


@pytest.mark.slow
def test_the_passes_left_out_change_no_machine_code():
    if not inlining.is_tested():
        pytest.skip("with this version of Numba all passes are run")
    state = SimpleNamespace(func_ir=None, flags=Flags())
    assert {kind.__name__ for kind, _ in DefaultPassBuilder.define_nopython_pipeline(state).passes} > passes.LEFT_OUT
    ours = machine_code(kernels.OPTIONS)
    assert ours == machine_code(kernels.OPTIONS | {"pipeline_class": Compiler})
    assert len(ours) > 100


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


def test_machine_code_is_loaded_without_all_that_could_be_compiled(tmp_path, monkeypatch):
    def made():
        dispatcher = kernels.entry_point(work.py_func)
        dispatcher._cache = kernel_cache.DiskCache(tmp_path, work.py_func)
        return dispatcher

    def refresh(context):
        raise AssertionError("looks for functions that compiled code may call")

    record = Outer(2.0, Inner(3, np.arange(4.0)), None, np.zeros(4))
    assert made()(record) == 24.0
    monkeypatch.setattr(type(work.targetctx), "refresh", refresh)
    monkeypatch.setattr(inlining, "TESTED", ((0, 0), (99, 0)))
    assert made()(record) == 32.0
    monkeypatch.setattr(inlining, "TESTED", ((0, 0), (0, 0)))
    with pytest.raises(AssertionError, match="looks for"):
        made()(record)


@kernels.kernel
def says(number):
    """What prints needs an environment."""
    print("kernel", number)
    return number + 1


def test_other_peoples_compiled_functions_work_as_ever(capfd):
    """Ufuncs, functions that only compiled functions can call, kernels that print, and indices from the end."""
    indices.install()

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
