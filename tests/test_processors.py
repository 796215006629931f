"""The same trajectories on every processor, for any number of threads, in every folder, language
and time zone.
"""

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray

import brownpipe as bp
from brownpipe import observables, provenance
from brownpipe.cli import main
from brownpipe.errors import DONE

SCENE = """\
box: {x: [-1.5, 1.5], y: [-1.0, 1.0], boundary: reflecting}
disks: {tracer: {radius: 0.2, mass: 3.0},
  species: [{name: bath, count: 24, radius: 0.1, mass: 0.5}]}
velocities: {temperature: 1.3}
equilibrate: {time: 0.5, tracer: free}
duration: 1.0
samples: {per_decade: 8, first: 0.01}
"""
OF_TRACKS = [name for name in observables.OBSERVABLES if not observables.needs_events([name])]
OBSERVABLES = ",".join(OF_TRACKS)
RUNS = ["simulate", "scene.yaml", "--seeds", "0-11", "--observables", OBSERVABLES]
STUDY = [
    [*RUNS[:-1], f"{OBSERVABLES},first_passage", "--record", "all", "--output", "exact.h5"],
    [
        *RUNS,
        "--engine",
        "timestep",
        "--time-step",
        "0.004",
        "--record",
        "all",
        "--output",
        "timestep.h5",
    ],
    [*RUNS, "--engine", "langevin", "--friction", "enskog", "--output", "langevin.h5"],
    ["aggregate", "exact.h5", "--fit-windows", "0.2:1", "--output", "dataset.nc"],
]
CHILD = (
    "import json, sys; from brownpipe.cli import main; sys.exit(any([main(w) for w in "
    "json.loads(sys.argv[1])]))"
)
# Sets of instructions for which NumPy has versions of its functions; each set contains those before
# it.
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


def in_old_surroundings(folder):
    """Make the study in a process of its own, with another umask."""
    (folder / "scene.yaml").write_text(SCENE)
    command = [sys.executable, "-c", CHILD, json.dumps(STUDY)]
    done = subprocess.run(
        command,
        cwd=folder,
        env=os.environ | OLD,
        umask=0o077,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == DONE, done.stderr


@pytest.mark.slow
def test_trajectories_have_the_same_bits_on_an_old_processor_elsewhere_and_other_numbers_agree(
    tmp_path, monkeypatch
):
    here = tmp_path / "here"
    there = tmp_path / "there" / "elsewhere"
    here.mkdir()
    there.mkdir(parents=True)
    monkeypatch.chdir(here)
    Path("scene.yaml").write_text(SCENE)
    for words in STUDY:
        assert main(words) == DONE
    in_old_surroundings(there)
    for file in ("exact.h5", "timestep.h5", "langevin.h5"):
        one, other = (bp.open(folder / file) for folder in (here, there))
        if file != "langevin.h5":
            for name in ("position", "velocity"):
                assert one.disks[name].values.tobytes() == other.disks[name].values.tobytes(), (
                    file,
                    name,
                )
        for name, values in one.data_vars.items():
            assert np.allclose(values, other[name], rtol=1e-9, atol=1e-12, equal_nan=True), (
                file,
                name,
            )
    xarray.testing.assert_allclose(
        bp.open(here / "dataset.nc"), bp.open(there / "dataset.nc"), rtol=1e-9, atol=1e-12
    )


# Functions of NumPy and Python whose last bit depends on the processor or on its linear algebra
# library.
VARYING = re.compile(
    r"(np|math)\.(exp2?|expm1|log(2|10|1p|addexp|space)?|(arc|a)?(sin|cos|tan)h?|(arc|a)tan2|cbrt"
    r"|hypot|pow|power|float_power|geomspace|linalg|fft|v?dot|inner|matmul|tensordot)"
)
SAME = {  # where they are used all the same, and why no bit of a trajectory depends on them
    "exact/layout.py: math.log2": "rounded up to a power of two",
    "exact/layout.py: np.hypot": "cells that a big disk reaches, or by round-off does not",
    "exact/run.py: @": "whether a run stands still, in orders of magnitude",
    "start/initial_state.py: np.hypot": "how far disks were pushed apart, for the user",
    "start/placement.py: np.hypot": "compared with other distances, hardly ever equal ones",
    "units.py: math.hypot": "rounded to a power of two",
}


def varying(source):
    """What in a source may have another last bit on another processor."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and VARYING.fullmatch(ast.unparse(node)):
            yield ast.unparse(node)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            yield "@"


def test_trajectories_are_computed_by_arithmetic_that_rounds_in_one_way():
    """Also in modules that no test of bytes reaches."""
    engines = provenance.PACKAGE / "engines"
    files = [engines / f"{name}.py" for name in ("collisions", "ensemble", "recording", "units")]
    for folder in ("exact", "start", "timestep"):
        files += sorted((engines / folder).glob("*.py"))
    found = set()
    for file in files:
        name = file.relative_to(engines).as_posix()
        found.update(f"{name}: {expression}" for expression in varying(file.read_text()))
    assert found == SAME.keys()
