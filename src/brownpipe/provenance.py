"""Which source files and package versions determine a result. Imports nothing heavy.

The source files of a result are found by their imports: a module and every module of brownpipe that it imports,
directly or not, at the head of a file or inside a function.
"""

import hashlib
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).parent
NAME = PACKAGE.name
CATALOGUE = f"{NAME}.engines"  # imports all engines, but only the one that runs determines the results
IMPORT = re.compile(rf"^[ \t]*(?:from ({NAME}[\w.]*) import (\([^)]*\)|[^\n#]*)|import ({NAME}[\w.]*))", re.MULTILINE)


class Step(NamedTuple):
    """What determines the output of a step of the pipeline, besides its input and options."""

    modules: tuple[str, ...]  # of brownpipe, with all modules that they import; `figures.*`: every module of a room
    packages: tuple[str, ...]  # whose versions count


STEPS = {
    "simulate": Step(("storage.trajectories",), ("numpy", "numba", "h5py")),  # and the engine
    "aggregate": Step(("storage", "analysis"), ("numpy", "scipy", "xarray", "h5py")),
    "tradeoff": Step(("storage", "tradeoff"), ("numpy", "scipy", "xarray", "h5py")),
    "tradeoff_figures": Step(("figures.tradeoff",), ("numpy", "matplotlib")),
    "figures": Step(("figures.*",), ("numpy", "matplotlib")),
}


def made_with(step: str, engine: str | None = None) -> dict[str, str]:
    """Return the digest of a step's source and the versions of its packages; if one changes, the step is run again.

    With an `engine`, its source is part of the step.
    """
    modules, packages = STEPS[step]
    roots = modules if engine is None else (*modules, simulation_of(engine))
    return {"source": source_digest(*roots)} | {name: _version(name) for name in packages}


def simulation_of(engine: str) -> str:
    """Return the module that runs an engine, without the name of the package."""
    return f"engines.{engine}.simulation"


def source_digest(*modules: str, folder: Path = PACKAGE) -> str:
    """Return the SHA-256 over the source text of modules and of all that they import, whatever the line ends.

    Raises FileNotFoundError for a missing module.
    """
    total = hashlib.sha256()
    for file in sources(*modules, folder=folder):
        text = file.read_text(encoding="utf-8").encode()
        total.update(f"{file.relative_to(folder).as_posix()} {len(text)}\n".encode())
        total.update(text)
    return total.hexdigest()


@cache
def sources(*modules: str, folder: Path = PACKAGE) -> tuple[Path, ...]:
    """Return the files of modules and of all that they import, sorted; imports of the list of engines are not followed.

    Raises FileNotFoundError for a missing module.
    """
    files: dict[str, Path] = {}
    waiting = [f"{NAME}.{member}" for name in modules for member in _members(folder, name)]
    while waiting:
        module = waiting.pop()
        if module in files or module == CATALOGUE:
            continue
        file = _file(folder, module)
        if file is None:
            raise FileNotFoundError(f"{folder}: has no module {module}")
        files[module] = file
        waiting += _imported(folder, file)
    return tuple(sorted(files.values()))


def _members(folder: Path, name: str) -> list[str]:
    """Return the modules of a room for a name such as `figures.*`, otherwise the name itself."""
    room, every, _ = name.partition(".*")
    return [f"{room}.{file.stem}" for file in (folder / room).glob("[!_]*.py")] if every else [name]


def _imported(folder: Path, file: Path) -> list[str]:
    """Return the modules that a file imports, or imports names from."""
    modules = []
    for package, names, module in IMPORT.findall(file.read_text(encoding="utf-8")):
        for name in re.findall(r"(\w+)(?: as \w+)?", names):
            modules.append(f"{package}.{name}" if _file(folder, f"{package}.{name}") else package)
        modules += [module] if module else []
    return modules


def _file(folder: Path, module: str) -> Path | None:
    """Return the file of a module below the folder of the package, None if there is none."""
    path = folder.joinpath(*module.split(".")[1:])
    candidates = (path / "__init__.py", path.with_suffix(".py")) if path != folder else (path / "__init__.py",)
    return next((file for file in candidates if file.is_file()), None)


@cache
def versions() -> dict[str, str]:
    """Return the versions of brownpipe and of the packages that determine its numbers and its files."""
    return {f"{name}_version": _version(name) for name in ("brownpipe", "numpy", "numba", "h5py")}


def _version(name: str) -> str:
    """Return the version of an installed package."""
    from importlib.metadata import PackageNotFoundError, version  # takes 15 ms

    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"
