"""Which layer of src/brownpipe may import which, and which source files are in the digests of what
is made with them.

It is read from every import statement at every depth.
"""

import ast
import re
from functools import cache

import pytest

from brownpipe import provenance
from brownpipe.analysis.dataset import ESTIMATORS
from brownpipe.engines import DEFINITIONS

LAYERS = [  # each may import those before it
    *("text", "errors", "provenance", "progress", "processes", "theory"),
    *("scene", "observables", "needs", "engines", "storage", "analysis", "tradeoff"),
    *("figures", "report", "inspection", "study", "interface", "verbs", "cli", "__main__"),
]
FILES = sorted(provenance.PACKAGE.rglob("*.py"))
HELPERS = (
    "errors.py",
    "provenance.py",
    "progress.py",
    "processes.py",
    "text.py",
)  # to keep machine code and say that it is made
ENTRY_POINTS = ("engines.exact.events", "engines.timestep.steps", "engines.start.insertion")


@cache
def own_imports(file):
    """The modules of brownpipe that a file imports, at any depth."""
    found = []
    for one in ast.walk(ast.parse(file.read_text())):
        if isinstance(one, ast.Import):
            found += [alias.name for alias in one.names]
        elif isinstance(one, ast.ImportFrom):
            assert one.level == 0, (
                f"{file}: a relative import, which the digests of sources do not follow"
            )
            names = [f"{one.module}.{alias.name}" for alias in one.names]
            found += [name if name in MODULES else one.module for name in names]
    return [module for module in found if module.split(".")[0] == "brownpipe"]


def name_of(file):
    parts = file.relative_to(provenance.PACKAGE).with_suffix("").parts
    return ".".join(("brownpipe", *(parts[:-1] if parts[-1] == "__init__" else parts)))


MODULES = {name_of(file): file for file in FILES}


def needed_by(*modules):
    """The files of modules and of all that they import; the list of engines imports all engines,
    and is left out.
    """
    files = {}
    waiting = list(modules)
    while waiting:
        module = waiting.pop()
        if module not in files and module != "brownpipe.engines":
            files[module] = MODULES[module]
            waiting += own_imports(MODULES[module])
    return {file.relative_to(provenance.PACKAGE).as_posix() for file in files.values()}


def layer_of(module):
    return [*module.split("."), "__init__"][1]


def test_no_import_climbs():
    climbing = []
    for name in sorted(MODULES.keys() - {"brownpipe"}):
        layer = LAYERS.index(layer_of(name))
        for other in own_imports(MODULES[name]):
            if LAYERS.index(layer_of(other)) > layer:
                climbing.append(f"{name} imports {other}")
    assert climbing == []


def test_files_and_tables_are_known_from_storage_on():
    known = re.compile(r"^ *(?:import|from) (?:h5py|h5netcdf|xarray|pandas)\b", re.MULTILINE)
    below = [
        name
        for name in MODULES
        if name != "brownpipe" and layer_of(name) in LAYERS[: LAYERS.index("storage")]
    ]
    assert len(below) > 40
    assert [name for name in below if known.search(MODULES[name].read_text())] == []


def test_no_module_imports_snakemake():
    """It is an extra: `brownpipe run` starts it as a program, which loads the logger plugin."""
    imported = re.compile(r"^ *(?:import|from) snakemake", re.MULTILINE)
    assert [name for name in MODULES if imported.search(MODULES[name].read_text())] == []


@pytest.mark.parametrize("module", ENTRY_POINTS)
def test_kernels_know_arrays_alone(module):
    """No scene, no file, no table: what is compiled into an entry point is kernels and the records
    they work on.
    """
    known = needed_by(f"brownpipe.{module}")
    assert all(name.startswith("engines/") or name in HELPERS for name in known), known


# -- digests of sources ----------------------------------------------------------------------------

CASES = [
    *(("simulate", engine) for engine in DEFINITIONS),
    ("aggregate", None),
    ("tradeoff", None),
    ("figures", None),
]
SILENT = (  # what a step imports and what decides no number and no byte of its output
    *("progress.py", "processes.py"),  # progress, processes and signals
    *("errors.py", "text.py", "provenance.py"),  # messages
    *(
        f"engines/{engine}/__init__.py" for engine in DEFINITIONS
    ),  # refusals; settings are arguments
)
MAKERS = {  # what makes and writes the results of a step
    "simulate": (
        "brownpipe.engines.ensemble",
        "brownpipe.scene.variation",
        "brownpipe.storage.trajectories",
    ),
    "aggregate": ("brownpipe.analysis", "brownpipe.storage.datasets"),
    "tradeoff": ("brownpipe.tradeoff", "brownpipe.storage.datasets"),
    "figures": ("brownpipe.report.products", "brownpipe.engines.exact.simulation"),
}


def names(files):
    return {file.relative_to(provenance.PACKAGE).as_posix() for file in files}


@pytest.mark.parametrize(("step", "engine"), CASES)
def test_what_a_step_imports_is_in_the_digest_or_decides_nothing(step, engine):
    """A layer that a step begins to import must be entered in the step or, with its reason,
    above.
    """
    known = names(provenance.sources(step, engine))
    modules = [*MAKERS[step], *([DEFINITIONS[engine].simulation] if engine else [])]
    assert [
        name for name in sorted(needed_by(*modules) - known) if not name.startswith(SILENT)
    ] == []


def test_an_edit_is_another_source_but_line_ends_are_not(tmp_path, monkeypatch):
    monkeypatch.setitem(provenance.STEPS, "simulate", ("one.py", "layer/*"))

    def digest():
        provenance.source_digest.cache_clear()
        return provenance.source_digest("simulate", folder=tmp_path)

    (tmp_path / "layer" / "inner").mkdir(parents=True)
    digests = [digest()]
    for name in ("one.py", "layer/two.py", "layer/two.css"):
        (tmp_path / name).write_bytes(b"A = 1\n")
        digests.append(digest())
    assert len({*digests}) == 4
    for name, text in (
        ("one.py", b"A = 1\r\n"),
        ("three.py", b""),
        ("layer/two.py~", b""),
        ("layer/inner/x.py", b""),
    ):
        (tmp_path / name).write_bytes(text)
        assert digest() == digests[-1]


def test_every_estimator_is_listed():
    """One that is not would never run."""
    folder = provenance.PACKAGE / "analysis"
    files = {file.stem for file in folder.glob("*.py") if "\nESTIMATOR = " in file.read_text()}
    assert files == {estimator.name for estimator in ESTIMATORS}
