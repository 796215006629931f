"""The test files that cover a source file: python tests/tests_of.py src/brownpipe/theory.py

A test file covers a source file if it
- imports it, or from a package above it a name that the file defines;
- uses `brownpipe` itself, which is its Python interface;
- has the name of a verb or of a figure that is defined there, in quotes.
If there is none, those count that cover a file which imports it, as for kernels of an engine.
All is read from the syntax of both; no test is run.
"""

import ast
import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

TESTS = Path(__file__).parent
SOURCE = TESTS.parent / "src"


class Source(NamedTuple):
    """What may be used of a source file."""

    module: str  # brownpipe.engines.friction
    public: set[str]  # names of its functions and classes
    verbs_and_figures: set[str]  # by name
    imports: set[str]  # modules, and names in them, with dots


def imports_of(tree):
    """What a file imports: modules, and names with their module before them."""
    imported = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add(node.module)
            imported |= {f"{node.module}.{alias.name}" for alias in node.names}
    return imported


def verbs_and_figures(file, tree):
    """Names of verbs, which are the first arguments of Verb(...); a figure has its file's name."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    verbs = {call.args[0].value for call in calls if ast.unparse(call.func) == "Verb"}
    return verbs | {file.stem} if file.parent.name == "figures" else verbs


def module_of(file):
    names = file.relative_to(SOURCE).with_suffix("").parts
    return ".".join(names).removesuffix(".__init__")


@cache
def sources():
    """What each source file has, by its path."""
    parts = {}
    for file in sorted((SOURCE / "brownpipe").rglob("*.py")):
        tree = ast.parse(file.read_text())
        kinds = (ast.FunctionDef, ast.ClassDef)
        names = [node.name for node in tree.body if isinstance(node, kinds)]
        public = {name for name in names if not name.startswith("_")}
        named = verbs_and_figures(file, tree)
        parts[file] = Source(module_of(file), public, named, imports_of(tree))
    return parts


def imported_from_above(source, imported):
    """Whether a name of the file is imported from a package above it."""
    above = [module for module in imported if source.module.startswith(f"{module}.")]
    return any(f"{package}.{name}" in imported for package in above for name in source.public)


def directly_covered(test):
    """Source files that a test file names."""
    tree = ast.parse(test.read_text())
    imported = imports_of(tree)
    if "brownpipe" in imported:
        imported.add("brownpipe.interface")
    quoted = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    return {
        file
        for file, source in sources().items()
        if source.module in imported
        or imported_from_above(source, imported)
        or quoted & source.verbs_and_figures
    }


@cache
def covered_files():
    """Source files that each test file names, by test file."""
    return {test: directly_covered(test) for test in sorted(TESTS.glob("test_*.py"))}


def importing(files):
    """Source files that import one of these files."""
    modules = {sources()[file].module for file in files}
    return {other for other, source in sources().items() if modules & source.imports}


def tests_of(file):
    """Test files that cover a source file, in alphabetical order."""
    files = {file}
    while files:
        tests = [test for test, covered in covered_files().items() if covered & files]
        if tests:
            return tests
        files = importing(files)
    return []


if __name__ == "__main__":
    path = Path(sys.argv[1]).resolve()
    if path not in sources():
        sys.exit(f"{sys.argv[1]!r} is no file in src/brownpipe/")
    print(*[test.relative_to(TESTS.parent) for test in tests_of(path)])
