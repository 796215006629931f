"""Studies started as a user starts them, in a folder of their own, and their scenes."""

import os
import shutil
import sys
from pathlib import Path

import forked
from brownpipe.errors import DONE

ROOT = Path(__file__).parent.parent
PROGRAM = [sys.executable, "-m", "snakemake"]
SNAKEMAKE = [*PROGRAM, "--snakefile", str(ROOT / "Snakefile"), "--workflow-profile"]
SNAKEMAKE += [str(ROOT / "profiles" / "default")]
SCENE = """\
# a hot tracer
box: {x: [-3.0, 3.0], y: [-3.0, 3.0]}
particles: 10
disks:
  tracer: {radius: 0.3, mass: 1.0}
  species: [{name: bath, count: rest, radius: 0.1, mass: 0.4}]
velocities: {standard_deviation: 2.0}
duration: 1.0
sample_interval: 0.1
"""
FEW_DISKS = """\
box: {x: [-3.0, 3.0], y: [-3.0, 3.0]}
particles: 12
disks:
  tracer: {radius: 0.3, mass: 1.0, position: [0.0, 0.0]}
  species: [{name: bath, count: rest, radius: 0.1, mass: 0.4}]
velocities: {standard_deviation: 2.0}
duration: 0.5
sample_interval: 0.05
"""


def command(folder, *arguments):
    return [
        *SNAKEMAKE,
        "--directory",
        str(folder),
        "--configfile",
        str(folder / "study.yaml"),
        *arguments,
    ]


def environment(**more):
    """As in a shell: not as below `make test`."""
    usual = {name: value for name, value in os.environ.items() if name != "MAKEFLAGS"}
    return usual | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"} | more


def snakemake(folder, *arguments, status=DONE, **more):
    """What snakemake printed. It and the commands of its rules are forked processes."""
    words = command(folder, *arguments)[len(PROGRAM) :]
    path = f"{forked.programs()}:{environment()['PATH']}"
    done = forked.snakemake(*words, cwd=folder.parent, env=environment(**{"PATH": path} | more))
    assert done.returncode == status, done.printed
    return done.printed


def age_backwards(folder):
    """Let figures be older than their dataset, that than the runs, all in the future, and Snakemake
    know nothing.
    """
    shutil.rmtree(folder / ".snakemake")
    for age, path in enumerate(sorted((folder / "results").rglob("*.*"), reverse=True)):
        os.utime(path, (2e9 + age, 2e9 + age))
