"""Which source files determine a result, and with which versions of packages it was made. Imports
nothing heavy.

Versions of packages are recorded, but another version does not make a result outdated.
"""

import hashlib
import json
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path

PACKAGE = Path(__file__).parent
UNKNOWN = "unknown"  # version of a package that is not installed
NAME = PACKAGE.name
SUFFIXES = (".py", ".css", ".html", ".js", ".mplstyle", ".rst")  # of source files
PACKAGES = ("h5py", "llvmlite", "numba", "numpy", "scipy")  # that compute and write runs
ANALYSIS_PACKAGES = ("h5netcdf", "matplotlib", "pandas", "xarray")  # and datasets and figures

# Source files that determine the output of a step, besides its input and options;
# `tests/test_architecture.py` compares them with what is imported. `sources` adds those of the
# engine that runs; all engines use parts of the exact one.
RUNS = (
    "theory.py",
    "scene/*",
    "observables/*",
    "engines/*",
    "engines/start/*",
    "engines/compiled/*",
    "storage/*",
)
STEPS = {
    "simulate": (*RUNS, "engines/exact/*"),
    "aggregate": (*RUNS, "analysis/*"),
    "tradeoff": (*RUNS, "analysis/*", "tradeoff/*"),
    "figures": (
        *RUNS,
        "needs.py",
        "engines/exact/*",  # of the run in motion
        "analysis/*",
        "tradeoff/*",
        "figures/*",
        "report/*",
    ),
}


def digest_of(*values: object) -> str:
    """Return the first digits of a SHA-256 over values as JSON writes them."""
    text = json.dumps(values, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def made_with(step: str, engine: str | None = None) -> dict[str, str]:
    """Return the digest of a step's source, with that of an `engine` if given, and the versions of
    its packages.
    """
    return {"source_digest": source_digest(step, engine)} | versions(step)


def sources(step: str, engine: str | None = None, folder: Path = PACKAGE) -> list[Path]:
    """Return the source files that determine the output of a step, sorted; with those of an
    `engine`.
    """
    patterns = [*STEPS[step]]
    if engine is not None:
        patterns.append(f"engines/{engine}/*")
    files: set[Path] = set()
    for pattern in patterns:
        files.update(folder.glob(pattern))
    return sorted(file for file in files if file.suffix in SUFFIXES)


@cache  # a study asks for it once for each set of runs
def source_digest(step: str, engine: str | None = None, folder: Path = PACKAGE) -> str:
    """Return the SHA-256 over names and texts of the `sources` of a step; the kind of line ends has
    no effect.
    """
    total = hashlib.sha256()
    for file in sources(step, engine, folder):
        text = file.read_text(encoding="utf-8").encode()
        name = file.relative_to(folder).as_posix()
        total.update(f"{name} {len(text)}\n".encode())
        total.update(text)
    return total.hexdigest()


def module_of(function: str | Callable) -> tuple[str, str]:
    """Return the module of a user's function, or a module by its name, which is imported, and the
    SHA-256 of its file; "" if it has no file, as in a notebook.
    """
    if isinstance(function, str):
        name = function
        import_module(name)
    else:
        name = function.__module__
    file = getattr(sys.modules.get(name), "__file__", None)
    if file is None:
        return name, ""
    return name, hashlib.sha256(Path(file).read_bytes()).hexdigest()


def versions(step: str = "simulate") -> dict[str, str]:
    """Return the versions of brownpipe and of the packages that compute and write what a step
    makes.
    """
    names = [NAME, *PACKAGES]
    if step != "simulate":
        names += ANALYSIS_PACKAGES
    return {f"{name}_version": _version(name) for name in names}


@cache
def _version(name: str) -> str:
    from importlib.metadata import PackageNotFoundError, version  # takes 15 ms

    try:
        return version(name)
    except PackageNotFoundError:
        return UNKNOWN
