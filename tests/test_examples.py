"""Examples in docstrings give what they say, and every function and class of the Python interface
has one.
"""

import doctest
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import numpy as np
import pytest

import brownpipe as bp
from brownpipe import interface, provenance
from brownpipe.errors import DONE

SCENE = """
box: {x: [0, 8], y: [0, 8], boundary: periodic}
particles: 31
disks:
  tracer: {radius: 0.5, mass: 4.0}
  species:
    - {name: bath, count: rest, radius: 0.2, mass: 1.0}
velocities: {temperature: 1.0}
duration: 8.0
sample_interval: 0.2
"""
STUDY = """
scenes: [heavy.yaml]
seeds: 20
fit_windows: [[2, 8]]
figures: [msd]
"""
NAMES = [name for name in bp.__all__ if not name.endswith("Error")]  # no one calls an error
ALL_MODULES = [module.name for module in walk_packages([str(provenance.PACKAGE.parent)])]
# the first runs the command line; the examples of the second are run by name
LEFT_OUT = ("brownpipe.__main__", interface.__name__)
MODULES = [name for name in ALL_MODULES if name not in LEFT_OUT]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files that examples read."""
    folder = tmp_path_factory.mktemp("examples")
    (folder / "heavy.yaml").write_text(SCENE)
    (folder / "study.yaml").write_text(STUDY)
    return folder


@pytest.fixture(scope="module")
def names(folder):
    """What the docstring of the interface says that examples know."""
    scene = bp.read_scene(folder / "heavy.yaml")
    runs = bp.simulate(scene, seeds=20)
    result = bp.analyse(runs, fit_windows=[(2, 8)])
    return {"bp": bp, "np": np, "scene": scene, "runs": runs, "result": result}


@pytest.fixture
def workflow(names, monkeypatch):
    """In place of the workflow, which test_interface runs, its dataset where it would store it."""

    def store(command):
        stored = Path("results", "study", "aggregate", "study.nc")
        stored.parent.mkdir(parents=True)
        bp.save(names["result"], stored)
        return DONE, ""

    monkeypatch.setattr(interface.progress, "relayed", store)


@pytest.mark.parametrize("name", NAMES)
def test_examples_give_what_they_say(name, folder, names, workflow, monkeypatch):
    monkeypatch.chdir(folder)
    docstring = getattr(bp, name).__doc__
    example = doctest.DocTestParser().get_doctest(docstring, names, name, None, None)
    assert example.examples, f"the docstring of {name} has no example"
    outcome = doctest.DocTestRunner().run(example)
    assert outcome.failed == 0


@pytest.mark.parametrize("name", MODULES)
def test_examples_of_modules_give_what_they_say(name, names):
    outcome = doctest.testmod(import_module(name), extraglobs=names)
    assert outcome.failed == 0
