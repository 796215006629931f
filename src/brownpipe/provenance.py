"""What results are made with: the source code and the package versions that decide them. Imports nothing heavy.

Which source files decide a result is read from their imports: a module, and everything of brownpipe that it imports,
directly or not, at the head of a file or inside a function.
"""

import hashlib
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).parent
NAME = PACKAGE.name
CATALOGUE = f"{NAME}.engines"  # leads to all engines, of which only the one that runs decides its results
IMPORT = re.compile(rf"^[ \t]*(?:from ({NAME}[\w.]*) import (\([^)]*\)|[^\n#]*)|import ({NAME}[\w.]*))", re.MULTILINE)


class Step(NamedTuple):
    """What decides the outcome of a step of the pipeline, besides what the step is given."""

    modules: tuple[str, ...]  # of brownpipe, with all that they import
    packages: tuple[str, ...]


STEPS = {
    "simulate": Step(("storage.trajectories",), ("numpy", "numba", "h5py")),  # and the engine
    "aggregate": Step(("storage", "analysis"), ("numpy", "scipy", "xarray", "h5py")),
    "tradeoff": Step(("storage", "tradeoff"), ("numpy", "scipy", "xarray", "h5py")),
    "tradeoff_figures": Step(("figures.tradeoff",), ("numpy", "matplotlib")),
    "figures": Step(("figures",), ("numpy", "matplotlib")),
}


def made_with(step: str, engine: str | None = None) -> dict[str, str]:
    """The digest of a step's source and the versions of its packages: when one of them changes, it is run again.

    The source of the engine is part of the step that runs it.
    """
    modules, packages = STEPS[step]
    roots = modules if engine is None else (*modules, simulation_of(engine))
    return {"source": source_digest(*roots)} | {name: _version(name) for name in packages}


def simulation_of(engine: str) -> str:
    """The module that runs an engine, without the name of the package."""
    return f"engines.{engine}.simulation"


def source_digest(*modules: str, folder: Path = PACKAGE) -> str:
    """The sha256 over the source text of modules and of all that they import; line ends do not count.

    Raises FileNotFoundError for a module that is not there.
    """
    total = hashlib.sha256()
    for file in sources(*modules, folder=folder):
        text = file.read_text(encoding="utf-8").encode()
        total.update(f"{file.relative_to(folder).as_posix()} {len(text)}\n".encode())
        total.update(text)
    return total.hexdigest()


@cache
def sources(*modules: str, folder: Path = PACKAGE) -> tuple[Path, ...]:
    """The files of modules and of all that they import, sorted; the list of engines is not followed.

    Raises FileNotFoundError for a module that is not there.
    """
    found, waiting = {}, [f"{NAME}.{one}" for one in modules]
    while waiting:
        module = waiting.pop()
        if module in found or module == CATALOGUE:
            continue
        file = _file(folder, module)
        if file is None:
            raise FileNotFoundError(f"{folder}: has no module {module}")
        found[module] = file
        waiting += _imported(folder, file)
    return tuple(sorted(found.values()))


def _imported(folder: Path, file: Path) -> list[str]:
    """The modules that a file imports, or whose names it imports."""
    modules = []
    for package, names, module in IMPORT.findall(file.read_text(encoding="utf-8")):
        for name in re.findall(r"(\w+)(?: as \w+)?", names):
            modules.append(f"{package}.{name}" if _file(folder, f"{package}.{name}") else package)
        modules += [module] if module else []
    return modules


def _file(folder: Path, module: str) -> Path | None:
    path = folder.joinpath(*module.split(".")[1:])
    candidates = (path / "__init__.py", path.with_suffix(".py")) if path != folder else (path / "__init__.py",)
    return next((one for one in candidates if one.is_file()), None)


@cache
def versions() -> dict[str, str]:
    """Versions of brownpipe and of the packages that decide its numbers and its files."""
    return {f"{name}_version": _version(name) for name in ("brownpipe", "numpy", "numba", "h5py")}


def _version(name):
    from importlib.metadata import PackageNotFoundError, version  # takes 15 ms

    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"
