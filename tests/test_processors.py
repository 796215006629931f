"""The same bytes on every processor, for any number of threads, in every folder, language and time zone."""

import ast
import json
import os
import subprocess
import sys
from hashlib import sha256

import numpy as np
import pytest

from brownpipe import observables, provenance
from brownpipe.cli import main
from brownpipe.engines import DEFINITIONS
from brownpipe.errors import DONE

SCENE = """\
box: {x: [-1.5, 1.5], y: [-1.0, 1.0], boundary: reflecting}
disks: {tracer: {radius: 0.2, mass: 3.0}, species: [{name: bath, count: 24, radius: 0.1, mass: 0.5}]}
velocities: {temperature: 1.3}
equilibrate: {time: 0.5, tracer: free}
duration: 1.0
samples: {per_decade: 8, first: 0.01}
"""
OBSERVABLES = ",".join(observables.OBSERVABLES)
RUNS = ["simulate", "scene.yaml", "--seeds", "0-11", "--observables", OBSERVABLES]
STUDY = [
    [*RUNS, "--record", "all", "--output", "exact.h5"],
    [*RUNS, "--engine", "timestep", "--time-step", "0.004", "--output", "timestep.h5"],
    [*RUNS, "--engine", "langevin", "--friction", "enskog", "--output", "langevin.h5"],
    ["aggregate", "exact.h5", "timestep.h5", "langevin.h5", "--fit-windows", "0.2:1", "--output", "dataset.nc"],
]
FIGURES = [["figures", "dataset.nc", "--output", "figures", "--particles", "25"]]
CHILD = "import json, sys; from brownpipe.cli import main; sys.exit(any([main(w) for w in json.loads(sys.argv[1])]))"
# Sets of instructions for which NumPy has versions of its functions; each set contains those before it.
INSTRUCTIONS = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
SURROUNDINGS = {  # variables of a process, and values that change no result; "" for none
    "OPENBLAS_CORETYPE": ["Prescott", "Nehalem", "Sandybridge", "Haswell", "Zen", "SkylakeX"],
    "NPY_DISABLE_CPU_FEATURES": [" ".join(INSTRUCTIONS[first:]) for first in range(len(INSTRUCTIONS) + 1)],
    "OPENBLAS_NUM_THREADS": ["1", "2", "4"],
    "OMP_NUM_THREADS": ["", "1", "3"],
    "NUMBA_NUM_THREADS": ["", "1", "4"],
    "PYTHONDEVMODE": ["", "1"],
    "PYTHONHASHSEED": ["0", "1", "random"],
    "LC_ALL": ["C", "C.UTF-8", "de_DE.UTF-8", "tr_TR.UTF-8"],
    "TZ": ["UTC", "Asia/Kathmandu", "America/St_Johns"],
    "UMASK": ["022", "077"],  # of the process; not one of its variables
    "NUMBA_CPU_NAME": ["", "generic", "haswell"],  # kernels are compiled for it, which takes 20 s of CPU
}
OLD = {name: values[-1] for name, values in SURROUNDINGS.items()} | {
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_DISABLE_CPU_FEATURES": " ".join(INSTRUCTIONS),
    "PYTHONDEVMODE": "",
    "NUMBA_CPU_NAME": "",
}


def results(folder):
    """{path: digest} of the files that were made in a folder."""
    made = (path for path in folder.rglob("*") if path.is_file() and path.name != "scene.yaml")
    return {path.relative_to(folder).as_posix(): sha256(path.read_bytes()).hexdigest() for path in made}


def in_surroundings(surroundings, commands, folder):
    """The results of commands in a process of its own."""
    (folder / "scene.yaml").write_text(SCENE)
    others = {name: value for name, value in os.environ.items() if name not in surroundings}
    done = subprocess.run(
        [sys.executable, "-c", CHILD, json.dumps(commands)],
        cwd=folder,
        env=others | {name: value for name, value in surroundings.items() if value},
        umask=int(surroundings["UMASK"], 8),
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == DONE, done.stderr
    return results(folder)


@pytest.mark.slow
@pytest.mark.promise(
    "a processor without some instructions, other linear algebra, threads, language, time zone or folder",
    "Trajectories, datasets, tables and figures are the same, byte for byte.",
)
def test_results_have_the_same_bytes_in_all_surroundings(faults, tmp_path, monkeypatch):
    """In the everyday tests an old processor; with --faults random surroundings and figures, too."""
    commands = STUDY + (FIGURES if faults.factor > 1 else [])
    folders = [tmp_path / name for name in ("here", *map(str, range(faults.factor)))]
    folders[0].mkdir()
    monkeypatch.chdir(folders[0])
    (folders[0] / "scene.yaml").write_text(SCENE)
    for words in commands:
        assert main(words) == DONE
    expected = results(folders[0])
    assert expected.keys() >= {"exact.h5", "timestep.h5", "langevin.h5", "dataset.nc"}
    for k in faults.tries(1):
        drawn = {name: faults.random.choice(values) for name, values in SURROUNDINGS.items()}
        surroundings = drawn if k else OLD
        folder = folders[k + 1] / "elsewhere"
        folder.mkdir(parents=True)
        made = in_surroundings(surroundings, commands, folder)
        assert made.keys() == expected.keys()
        assert [name for name in made if made[name] != expected[name]] == [], surroundings


# Functions of NumPy and Python whose last bit depends on the processor or on its linear algebra library.
ELEMENTARY = (
    "exp exp2 expm1 log log2 log10 log1p sin cos tan arcsin arccos arctan arctan2 asin acos atan atan2 sinh cosh"
)
ELEMENTARY += " tanh arcsinh arccosh arctanh cbrt pow power float_power logaddexp geomspace logspace lgamma gamma"
ALGEBRA = "linalg polynomial dot vdot inner matmul tensordot polyfit vander cov corrcoef lstsq pinv fft convolve"
VARYING = {*ELEMENTARY.split(), *ALGEBRA.split()}
SAME = {  # where they are used, and why no stored number depends on them
    "elementary.py: math.cos": "where Newton's method begins",
    "elementary.py: (-1) ** k": "of integers",
    "elementary.py: 4 ** k": "of integers",
    "scene/sample_times.py: math.log10": "a number of samples, with tolerance",
    "scene/sample_times.py: 10 ** (k / samples.per_decade)": "Python's power, one for all processors with FMA",
    "engines/forecast.py: np.log": "a forecast of CPU time",
    "engines/saturation.py: (1.0 - share) ** runs": "a warning",
    "engines/exact/layout.py: math.log2": "rounded up to a power of two",
    "analysis/resampling.py: math.exp": "rounded to integers",
    "analysis/resampling.py: _weights(block)[:, rows[0]:rows[-1] + 1] @ full": "sums of integers below 2^24",
    "analysis/goodness.py: first ** 3": "of fractions",
    "tradeoff/compare.py: np.geomspace": "rounded to integers",
}


def varying(source):
    """What in a source may have another last bit on another processor."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("np", "math"):
            if node.attr in VARYING:
                yield f"{node.value.id}.{node.attr}"
        elif isinstance(node, ast.ImportFrom) and node.module in ("math", "numpy"):
            yield from (f"{node.module}.{alias.name}" for alias in node.names if alias.name in VARYING)
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            yield ast.unparse(node)
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            squared = isinstance(node.right, ast.Constant) and node.right.value == 2
            of_two = isinstance(node.left, ast.Constant) and node.left.value == 2
            constants = all(isinstance(leaf, ast.Constant) for leaf in (node.left, node.right))
            if not (squared or of_two or constants):
                yield ast.unparse(node)


@pytest.mark.parametrize(
    "source",
    [
        "np.exp(x)",
        "math.log(x)",
        "np.linalg.pinv(a)",
        "a @ b",
        "x ** 3",
        "x ** -0.5",
        "from math import exp",
        "a.T @ b",
    ],
)
def test_functions_that_depend_on_the_processor_are_found(source):
    assert [*varying(source)]


def test_stored_numbers_are_computed_by_arithmetic_of_one_result():
    """Also in modules that no test of bytes reaches. Numbers of figures are rounded to fewer digits."""
    steps = [(step, None) for step in ("aggregate", "tradeoff")] + [("simulate", engine) for engine in DEFINITIONS]
    decisive = {file for step in steps for file in provenance.sources(*provenance.modules_of(*step))}
    found = {
        f"{file.relative_to(provenance.PACKAGE).as_posix()}: {expression}"
        for file in decisive
        for expression in varying(file.read_text())
    }
    assert found == SAME.keys()
