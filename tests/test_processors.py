"""The same bytes on every processor, for any number of threads, in every folder, language and time zone."""

import ast
import json
import os
import re
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

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
CHILD = "import json, sys; from brownpipe.cli import main; sys.exit(any([main(w) for w in json.loads(sys.argv[1])]))"
# Sets of instructions for which NumPy has versions of its functions; each set contains those before it.
INSTRUCTIONS = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
OLD = {  # variables of a process; none changes a result
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_DISABLE_CPU_FEATURES": " ".join(INSTRUCTIONS),
    "OPENBLAS_NUM_THREADS": "4",
    "OMP_NUM_THREADS": "3",
    "NUMBA_NUM_THREADS": "4",
    "PYTHONHASHSEED": "random",
    "LC_ALL": "tr_TR.UTF-8",
    "TZ": "America/St_Johns",
}


def results(folder):
    """{path: digest} of the files that were made in a folder."""
    made = (path for path in folder.rglob("*") if path.is_file() and path.name != "scene.yaml")
    return {path.relative_to(folder).as_posix(): sha256(path.read_bytes()).hexdigest() for path in made}


def in_old_surroundings(folder):
    """The results of the study in a process of its own, with another umask."""
    (folder / "scene.yaml").write_text(SCENE)
    command = [sys.executable, "-c", CHILD, json.dumps(STUDY)]
    done = subprocess.run(
        command, cwd=folder, env=os.environ | OLD, umask=0o077, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == DONE, done.stderr
    return results(folder)


@pytest.mark.slow
def test_results_have_the_same_bytes_on_an_old_processor_elsewhere(tmp_path, monkeypatch):
    folders = [tmp_path / "here", tmp_path / "there" / "elsewhere"]
    for folder in folders:
        folder.mkdir(parents=True)
    monkeypatch.chdir(folders[0])
    Path("scene.yaml").write_text(SCENE)
    for words in STUDY:
        assert main(words) == DONE
    expected = results(folders[0])
    assert expected.keys() >= {"exact.h5", "timestep.h5", "langevin.h5", "dataset.nc"}
    assert in_old_surroundings(folders[1]) == expected


# Functions of NumPy and Python whose last bit depends on the processor or on its linear algebra library.
VARYING = re.compile(
    r"(np|math)\.(exp2?|expm1|log(2|10|1p|addexp|space)?|(arc|a)?(sin|cos|tan)h?|(arc|a)tan2|cbrt|pow|power|float_power"
    r"|geomspace|l?gamma|linalg|polynomial|v?dot|inner|matmul|tensordot|polyfit|vander|cov|corrcoef|pinv|convolve)"
)
SAME = {  # where they are used, and why no stored number depends on them
    "elementary.py: math.cos": "where Newton's method begins",
    "elementary.py: (-1) ** k": "of integers",
    "elementary.py: 4 ** k": "of integers",
    "scene/scene.py: math.log10": "a number of samples, with tolerance",
    "scene/scene.py: 10 ** (k / per_decade)": "Python's power, one for all processors with FMA",
    "scene/variation.py: (last / first) ** (k / (count - 1))": "Python's power, too",
    "engines/forecast.py: max(scene.particles / FITS_CACHE, 1.0) ** SLOWER": "a forecast of CPU time",
    "engines/saturation.py: (1.0 - share) ** runs": "a warning",
    "engines/exact/layout.py: math.log2": "rounded up to a power of two",
    "analysis/resampling.py: math.exp": "rounded to integers",
    "analysis/resampling.py: weights @ steps": "sums of integers below 2^24",
    "analysis/resampling.py: weights @ there": "sums of integers below 2^24",
}


def varying(source):
    """What in a source may have another last bit on another processor."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and VARYING.fullmatch(ast.unparse(node)):
            yield ast.unparse(node)
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult | ast.Pow):
            names = any(isinstance(leaf, ast.Name | ast.Attribute) for leaf in ast.walk(node))
            square_or_power_of_two = "2" in (ast.unparse(node.right), ast.unparse(node.left).removesuffix(".0"))
            if isinstance(node.op, ast.MatMult) or (names and not square_or_power_of_two):
                yield ast.unparse(node)


def test_stored_numbers_are_computed_by_arithmetic_of_one_result():
    """Also in modules that no test of bytes reaches. Numbers of figures are rounded to fewer digits."""
    steps = [(step, None) for step in ("aggregate", "tradeoff")] + [("simulate", engine) for engine in DEFINITIONS]
    decisive = {file for step in steps for file in provenance.sources(*provenance.modules_of(*step))}
    found = {
        f"{file.relative_to(provenance.PACKAGE).as_posix()}: {expression}"
        for file in decisive
        for expression in varying(file.read_text())
    }
    assert found - SAME.keys() == set()
