"""What a result is made with: no source file and no package that decides it is missing from its digest."""

import ast
import sys
from functools import cache
from importlib.metadata import packages_distributions

import pytest

from brownpipe import provenance
from brownpipe.cli import main
from brownpipe.engines import DEFINITIONS
from brownpipe.errors import DONE
from brownpipe.study import changes, read_study

CASES = [*(("simulate", engine) for engine in DEFINITIONS), ("aggregate", None), ("tradeoff", None)]
SILENT = {  # what a verb imports and what decides no number and no byte of its output
    "to read arguments, all of which are parameters of the job": {"verbs/", "study/", "scene/schema.py"},
    "to show progress and say what was made": {"progress.py", "formatting.py", "engines/failures.py"},
    "to recognise a file that holds exactly the runs asked for": {
        *("engines/request.py", "storage/expected.py", "storage/finished.py"),
    },
    "to verify files of another step": {"storage/checksums.py"},
    "to refuse and to forecast; settings of engines are arguments": {
        *("engines/definition.py", "engines/forecast.py", "engines/friction.py", "engines/saturation.py"),
        "engines/units.py",
        *(f"engines/{engine}/__init__.py" for engine in DEFINITIONS),
        "figures/catalogue.py",
    },
}
OF_OTHERS = {  # what it imports for other kinds of files or for other engines
    "simulate": {
        *("storage/__init__.py", "storage/datasets.py", "storage/origin.py", "storage/tree.py"),
        "engines/exact/checkpoint.py",
    },
    "aggregate": {"tradeoff/"},  # by the number of runs for a tolerance
    "tradeoff": set(),
}
pytestmark = pytest.mark.promise(
    "a result of other source code or packages is taken for up to date",
    "Each result has a digest of the source and the versions of the packages that decide it, found by imports; if one "
    "changes, the step runs again.",
)


def names(files):
    return {file.relative_to(provenance.PACKAGE).as_posix() for file in files}


@pytest.mark.parametrize(("step", "engine"), CASES)
def test_what_a_verb_imports_is_in_the_digest_or_decides_nothing(step, engine):
    """A module that a verb begins to import must be entered in the step or, with its reason, above."""
    modules = provenance.modules_of(step, engine)
    left = names(provenance.sources(f"verbs.{step}")) - names(provenance.sources(*modules))
    known = tuple(OF_OTHERS[step].union(*SILENT.values()))
    assert [name for name in sorted(left) if not name.startswith(known)] == []


owners = cache(packages_distributions)


@cache
def imports_of(file):
    """The packages that a file imports."""
    nodes = [*ast.walk(ast.parse(file.read_text()))]
    modules = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    modules += [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    return {module.partition(".")[0] for module in modules}


@pytest.mark.parametrize(("step", "engine"), [*CASES, ("tradeoff_figures", None), ("figures", None)])
def test_all_packages_that_are_imported_are_in_the_digest(step, engine):
    """By Python's own parser, and by what the installed packages say of their modules."""
    imported = set().union(*map(imports_of, provenance.sources(*provenance.modules_of(step, engine))))
    wanted = {owners()[name][0].lower() for name in imported - sys.stdlib_module_names - {"brownpipe"}}
    assert wanted, step
    assert wanted <= provenance.made_with(step, engine).keys()


def test_what_packages_load_is_in_the_digest_too():
    simulate = {"source", "h5py", "llvmlite", "numba", "numpy", "pyyaml", "scipy"}
    assert provenance.made_with("simulate", "exact").keys() == simulate
    assert {"xarray", "pandas"} <= provenance.made_with("aggregate").keys()
    assert {"matplotlib", "pillow", "contourpy"} <= provenance.made_with("figures").keys()


def test_a_package_that_a_module_begins_to_import_is_found(tmp_path):
    (tmp_path / "one.py").write_text("import os\nfrom brownpipe import two\n")
    two = tmp_path / "two.py"
    found = []
    for line in (
        "",
        "import numpy as np",
        "def f():\n    from numba import njit",
        "import yaml",
        "from gone import it",
    ):
        with open(two, "a") as file:
            file.write(f"{line}\n")
        for function in (provenance.sources, provenance.packages, provenance._statements):
            function.cache_clear()
        found.append(provenance.packages("one", folder=tmp_path))
    provenance.sources.cache_clear()
    with_numba = ("llvmlite", "numba", "numpy")
    assert found == [(), ("numpy",), with_numba, (*with_numba, "pyyaml"), (*with_numba, "pyyaml")]


def test_a_text_beside_a_module_is_in_its_digest(tmp_path):
    (tmp_path / "one.py").write_text("from brownpipe import two\n")
    digests = []
    for name in ("two.py", "two.css", "two.js", "two.rst", "three.css"):
        (tmp_path / name).write_text("")
        provenance.sources.cache_clear()
        digests.append(provenance.source_digest("one", folder=tmp_path))
    provenance.sources.cache_clear()
    assert len({*digests}) == 4 and digests[3] == digests[4], "three.css belongs to no module"


def test_every_text_of_the_package_lies_beside_a_module():
    texts = [file for file in provenance.PACKAGE.rglob("*") if file.suffix in provenance.BESIDE]
    assert texts and [file for file in texts if not file.with_suffix(".py").is_file()] == []


def test_the_list_of_engines_decides_but_not_the_engines_on_it():
    known = names(provenance.sources(*provenance.modules_of("simulate", "langevin")))
    assert {"engines/__init__.py", "scene/seeds.py"} <= known
    assert "engines/timestep/simulation.py" not in known


SCENE = """\
box: {x: [0.0, 4.0], y: [0.0, 4.0], boundary: periodic}
disks: {species: [{name: bath, count: 4, radius: 0.2, mass: 1.0}]}
velocities: {temperature: 1.0}
duration: 1.0
"""


def test_another_version_of_the_compiler_is_named_as_a_reason(elsewhere, tmp_path, monkeypatch):
    """Also of files of earlier versions, which have no version of it."""
    (tmp_path / "hot.yaml").write_text(SCENE)
    (tmp_path / "mine.yaml").write_text("scenes: hot.yaml\nseeds: 2\nbatch: 2\n")
    output = "results/mine/simulate/hot/N4/exact/0-1.h5"
    assert main(["simulate", "hot.yaml", "--seeds", "0-1", "--output", output]) == DONE
    study, versions, header = read_study("mine.yaml"), provenance.versions(), changes.read_header
    assert changes.changes(study) == []
    now = versions["llvmlite_version"]
    with monkeypatch.context() as patch:
        patch.setattr(changes, "versions", lambda: versions | {"llvmlite_version": "99"})
        assert changes.changes(study) == [f"engine exact: llvmlite {now} -> 99"]
    others = versions.keys() - {"llvmlite_version"}
    monkeypatch.setattr(changes, "read_header", lambda file: {name: header(file)[name] for name in others})
    assert changes.changes(study) == [f"engine exact: llvmlite unknown -> {now}"]
