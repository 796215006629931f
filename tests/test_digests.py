"""What a result is made with: no source file that decides it is missing from its digest."""

import pytest

from brownpipe import provenance
from brownpipe.engines import DEFINITIONS

CASES = [*(("simulate", engine) for engine in DEFINITIONS), ("aggregate", None), ("tradeoff", None)]
SILENT = {  # what a verb imports and what decides no number and no byte of its output
    "to read arguments, all of which are parameters of the job": {"verbs/", "study/"},
    "to show progress and say what was made": {"progress.py", "formatting.py", "engines/failures.py"},
    "to find runs and to recognise those asked for": {"storage/store.py"},
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


def names(files):
    return {file.relative_to(provenance.PACKAGE).as_posix() for file in files}


@pytest.mark.parametrize(("step", "engine"), CASES)
def test_what_a_verb_imports_is_in_the_digest_or_decides_nothing(step, engine):
    """A module that a verb begins to import must be entered in the step or, with its reason, above."""
    modules = provenance.modules_of(step, engine)
    left = names(provenance.sources(f"verbs.{step}")) - names(provenance.sources(*modules))
    known = tuple(OF_OTHERS[step].union(*SILENT.values()))
    assert [name for name in sorted(left) if not name.startswith(known)] == []


def test_a_text_beside_a_module_is_in_its_digest(tmp_path):
    (tmp_path / "one.py").write_text("from brownpipe import two\n")
    digests = []
    for name in ("two.py", "two.css", "two.js", "two.rst", "three.css"):
        (tmp_path / name).write_text("")
        provenance.source_digest.cache_clear()
        digests.append(provenance.source_digest("one", folder=tmp_path))
    provenance.source_digest.cache_clear()
    assert len({*digests}) == 4 and digests[3] == digests[4], "three.css belongs to no module"


def test_every_text_of_the_package_lies_beside_a_module():
    texts = [file for file in provenance.PACKAGE.rglob("*") if file.suffix in provenance.BESIDE]
    assert texts and [file for file in texts if not file.with_suffix(".py").is_file()] == []


def test_the_list_of_engines_decides_but_not_the_engines_on_it():
    known = names(provenance.sources(*provenance.modules_of("simulate", "langevin")))
    assert {"engines/__init__.py", "scene/seeds.py"} <= known
    assert "engines/timestep/simulation.py" not in known
