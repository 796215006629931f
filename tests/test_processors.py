"""The same bytes on every processor, for any number of threads, in every folder, language and time zone."""

import json
import os
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from brownpipe import observables
from brownpipe.cli import main
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
