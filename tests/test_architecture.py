"""The order of the layers, the folders and files of src/brownpipe: which layer may import which.

It is read from every import statement at every depth.
"""

import ast
import re
from functools import cache

import pytest

from brownpipe import provenance
from brownpipe.cli import build_parser
from brownpipe.engines import DEFINITIONS, recorded
from brownpipe.engines.forecast import Setting
from brownpipe.errors import RequestError
from brownpipe.scene.reading import Positive
from brownpipe.verbs import simulate

LAYERS = (  # each may import those before it
    "quoting",
    "errors",
    "interrupts",
    "formatting",
    "provenance",
    "stages",
    "parallel",
    "elementary",
    "theory",
    "scene",
    "observables",
    "engines",
    "progress",
    "storage",
    "analysis",
    "tradeoff",
    "figures",
    "report",
    "inspection",
    "study",
    "interface",
    "verbs",
    "cli",
    "__main__",
)
FILES = sorted(provenance.PACKAGE.rglob("*.py"))
HEAVY = {
    "importlib",
    "numba",
    "h5py",
    "scipy",
    "pandas",
    "xarray",
    "matplotlib",
    "yaml",
    "PIL",
    "gsd",
}  # may be imported where they are needed
HELPERS = ("provenance.py", "stages.py", "interrupts.py")  # to keep machine code, to say that kernels are compiled
ENTRY_POINTS = ("engines.exact.events", "engines.timestep.steps", "engines.insertion")


@cache
def imports_of(file):
    """(module, imported name or None, whether inside a function) of every import statement of a file."""
    return [*statements(file)]


def statements(file):
    tree = ast.parse(file.read_text())
    inside = {
        id(one)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for one in ast.walk(function)
    }
    for one in ast.walk(tree):
        if isinstance(one, ast.Import):
            yield from ((alias.name, None, id(one) in inside) for alias in one.names)
        elif isinstance(one, ast.ImportFrom):
            assert one.level == 0, f"{file}: a relative import, which the digests of sources do not follow"
            yield from ((one.module, alias.name, id(one) in inside) for alias in one.names)


def name_of(file):
    parts = file.relative_to(provenance.PACKAGE).with_suffix("").parts
    return ".".join(("brownpipe", *(parts[:-1] if parts[-1] == "__init__" else parts)))


MODULES = {name_of(file): file for file in FILES}


def own_imports(file, hidden=False):
    """The modules of brownpipe that a file imports; with `hidden`, only those inside functions."""
    for module, name, inside in imports_of(file):
        if module.split(".")[0] == "brownpipe" and (inside or not hidden):
            yield f"{module}.{name}" if f"{module}.{name}" in MODULES else module


def needed_by(*modules):
    """The files of modules and of all that they import; the list of engines imports all engines, and is left out."""
    files, waiting = {}, list(modules)
    while waiting:
        module = waiting.pop()
        if module not in files and module != "brownpipe.engines":
            files[module] = MODULES[module]
            waiting += own_imports(MODULES[module])
    return {file.relative_to(provenance.PACKAGE).as_posix() for file in files.values()}


def layer_of(module):
    return [*module.split("."), "__init__"][1]


def test_no_import_climbs():
    climbing = [
        f"{name} imports {other}"
        for name, file in MODULES.items()
        for other in own_imports(file)
        if name != "brownpipe" and LAYERS.index(layer_of(other)) > LAYERS.index(layer_of(name))
    ]
    assert climbing == []


def test_no_import_cycle():
    after = {name: set(own_imports(file)) for name, file in MODULES.items()}
    while after:
        free = {name for name, needed in after.items() if not needed & after.keys()}
        assert free, f"a cycle among {sorted(after)}"
        after = {name: needed for name, needed in after.items() if name not in free}


def test_imports_inside_functions_are_of_heavy_packages_or_at_the_border():
    """The command line imports what a verb needs when it is called; everything else imports brownpipe at its head."""
    hidden = [
        f"{name}: {module}"
        for name, file in MODULES.items()
        if not name.startswith("brownpipe.verbs.")
        for module, _, inside in imports_of(file)
        if inside and module.split(".")[0] not in HEAVY
    ]
    assert hidden == []


@pytest.mark.parametrize("module", ENTRY_POINTS)
def test_kernels_know_arrays_alone(module):
    """No scene, no file, no table: what is compiled into an entry point is kernels and the records they work on."""
    known = needed_by(f"brownpipe.{module}")
    assert all(name.startswith("engines/") or name in HELPERS for name in known), known


CHOOSING = ("Engine", "configured", "requested", "get", "startswith", "endswith")  # functions of a name


def deciding_strings(source):
    """The strings by which a source chooses: compared with, looked up, keys of a dict, or the name of an engine made.

    Other strings, such as labels of a figure, may happen to be equal to the name of an engine.
    """
    parts, words = [], set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Compare):
            parts += [node.left, *node.comparators]
        elif isinstance(node, ast.Dict):
            parts += [key for key in node.keys if key is not None]  # None: the place of ** in a dict
        elif isinstance(node, ast.Subscript):
            parts.append(node.slice)
        elif isinstance(node, ast.MatchValue):
            parts.append(node.value)
        elif isinstance(node, ast.Call):
            function = getattr(node.func, "id", getattr(node.func, "attr", None))
            parts += [*node.args, *(word.value for word in node.keywords)] if function in CHOOSING else []
            words |= {word.arg for word in node.keywords} if function == "dict" else set()
    leaves = [leaf for part in parts for leaf in ast.walk(part) if isinstance(leaf, ast.Constant)]
    return words | {leaf.value for leaf in leaves if isinstance(leaf.value, str)}


@pytest.mark.parametrize(
    "source",
    [
        "engine.name == 'drift'",
        "'drift' != engine.name",
        "name in ('exact', 'drift')",
        "COST = {'drift': 1.0}",
        "COST = dict(drift=1.0)",
        "COST['drift']",
        "COST.get('drift', 1.0)",
        "label.startswith('drift')",
        "engines.configured('drift')",
        "Engine(name='drift')",
        "match name:\n    case 'exact' | 'drift':\n        pass",
    ],
)
def test_a_choice_by_name_is_found(source):
    assert "drift" in deciding_strings(source)


@pytest.mark.parametrize("source", ["axes.set_title('drift')", "LABELS = ('drift', 'heat')", "f(unit='drift')"])
def test_a_label_is_no_choice(source):
    assert "drift" not in deciding_strings(source)


@pytest.mark.slow
def test_no_other_layer_chooses_by_the_name_of_an_approximate_engine():
    """What depends on an engine is in its package, so that a new one needs its package and a line in DEFINITIONS."""
    names = set(DEFINITIONS) - {"exact"}  # the reference that the others are compared with
    choices = [
        f"{module}: {name}"
        for module, file in MODULES.items()
        if not module.startswith("brownpipe.engines.")
        for name in sorted(deciding_strings(file.read_text()) & names)
    ]
    assert choices == []


def test_a_new_engine_needs_nothing_but_its_definition(monkeypatch):
    """Command line, study, label and options of an engine that was not there when they were written."""
    settings = {"field": Setting(Positive, "E", "must be given")}
    drift = DEFINITIONS["timestep"]._replace(name="drift", summary="in a field", settings=settings)
    monkeypatch.setitem(DEFINITIONS, "drift", drift)
    words = ["simulate", "scene.yaml", "--engine", "drift", "--field", "2.5"]
    parser = build_parser(words)
    arguments = parser.parse_args(words)
    engine = simulate.engine_of(arguments)
    assert (engine.label, engine.options) == ("drift-2.5", "drift --field 2.5")
    assert recorded({"name": "drift", "field": 2.5}) == engine
    with pytest.raises(RequestError, match="the exact engine has no such setting; must go with drift"):
        simulate.engine_of(parser.parse_args([*words[:2], *words[4:]]))


@pytest.mark.parametrize("engine", DEFINITIONS)
def test_the_table_of_engines_has_its_settings(engine):
    text = (provenance.PACKAGE.parents[1] / "config" / "README.md").read_text()
    (row,) = re.findall(rf"^\| `{engine}` \| (.*?) \|", text, re.MULTILINE)
    assert re.findall(r"`(\w+)`:", row) == list(DEFINITIONS[engine].settings)
