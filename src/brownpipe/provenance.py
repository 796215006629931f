"""Which source files determine a result, and with which versions of packages it was made. Imports nothing heavy.

The source files of a result are a module and every module of brownpipe that it imports, at the head of a file or inside
a function, directly or not, and what lies beside one of these modules under its name: a caption, a style sheet or a
script. Versions of packages are recorded, but do not make a result another one.
"""

import hashlib
import json
import re
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parent
UNKNOWN = "unknown"  # version of a package that is not installed
NAME = PACKAGE.name
CATALOGUE = f"{NAME}.engines"  # imports all engines, but only the one that runs determines the results
IMPORT = re.compile(r"^[ \t]*(?:from (\w[\w.]*) import (\([^)]*\)|[^\n#]*)|import (\w[\w.]*))", re.MULTILINE)
BESIDE = (".css", ".html", ".js", ".mplstyle", ".rst")  # suffixes of files that belong to the module of the same name
PACKAGES = ("h5py", "llvmlite", "numba", "numpy", "scipy")  # that compute and write runs
ANALYSIS_PACKAGES = ("h5netcdf", "matplotlib", "pandas", "xarray")  # and datasets and figures

# Modules of brownpipe that determine the output of a step, besides its input and options, with all that they import.
# `figures.*` stands for every module of a layer. The engine that runs is added.
STEPS = {
    "simulate": ("engines", "scene.seeds", "storage.trajectories", "storage.checkpoints"),
    "aggregate": ("storage", "analysis"),
    "tradeoff": ("storage", "tradeoff"),
    "tradeoff_figures": ("storage", "figures.tradeoff", "report.tradeoff"),
    "figures": ("storage", "figures.*", "report.*"),
}


def digest_of(*parts: object) -> str:
    """Return the first digits of a SHA-256 over values as JSON writes them."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()[:12]


def made_with(step: str, engine: str | None = None) -> dict[str, str]:
    """Return the digest of a step's source and the versions of its packages; with an `engine`, that is part of it."""
    return {"source_digest": source_digest(*modules_of(step, engine))} | versions(step)


def modules_of(step: str, engine: str | None = None) -> tuple[str, ...]:
    """Return the modules that determine the output of a step, with all that they import; with that of an `engine`."""
    return STEPS[step] if engine is None else (*STEPS[step], simulation_of(engine))


def simulation_of(engine: str) -> str:
    """Return the module that runs an engine, without the name of the package."""
    return f"engines.{engine}.simulation"


@cache  # a study asks for it once for each set of runs
def source_digest(*modules: str, folder: Path = PACKAGE) -> str:
    """Return the SHA-256 over the source text of modules and of all that they import, whatever the line ends.

    The texts that lie beside these modules are part of it. Raises FileNotFoundError for a missing module.
    """
    files = sources(*modules, folder=folder)
    texts = [file for module in files for suffix in BESIDE if (file := module.with_suffix(suffix)).is_file()]
    total = hashlib.sha256()
    for file in sorted([*files, *texts]):
        text = file.read_text(encoding="utf-8").encode()
        total.update(f"{file.relative_to(folder).as_posix()} {len(text)}\n".encode())
        total.update(text)
    return total.hexdigest()


def sources(*modules: str, folder: Path = PACKAGE) -> tuple[Path, ...]:
    """Return the files of modules and of all that they import, sorted; imports of the list of engines are not followed.

    The list itself is among them if a file imports names from it.

    Raises FileNotFoundError for a missing module.
    """
    files: dict[str, Path] = {}
    waiting = [f"{NAME}.{member}" for name in modules for member in _members(folder, name)]
    while waiting:
        module = waiting.pop()
        if module in files:
            continue
        file = _file(folder, module)
        if file is None:
            raise FileNotFoundError(f"{folder}: has no module {module}")
        files[module] = file
        waiting += _imported(folder, file) if module != CATALOGUE else []
    return tuple(sorted(files.values()))


def _members(folder: Path, name: str) -> list[str]:
    """Return the modules of a layer for a name such as `figures.*`, otherwise the name itself."""
    layer, every, _ = name.partition(".*")
    return [f"{layer}.{file.stem}" for file in (folder / layer).glob("[!_]*.py")] if every else [name]


@cache  # the steps share most of their files
def _imported(folder: Path, file: Path) -> tuple[str, ...]:
    """Return the modules that a file imports, or imports names from."""
    modules = []
    for package, names, module in _statements(file):
        if _top(package or module) != NAME:
            continue
        for name in re.findall(r"(\w+)(?: as \w+)?", names):
            modules.append(f"{package}.{name}" if _file(folder, f"{package}.{name}") else package)
        modules += [module] if module else []
    return tuple(modules)


@cache
def _statements(file: Path) -> list[tuple[str, str, str]]:
    """Return the import statements of a file: package and names of `from`, and module of `import`; others are empty."""
    return IMPORT.findall(file.read_text(encoding="utf-8"))


def _top(module: str) -> str:
    return module.partition(".")[0]


@cache
def _file(folder: Path, module: str) -> Path | None:
    """Return the file of a module below the folder of the package, None if there is none."""
    path = folder.joinpath(*module.split(".")[1:])
    return next((file for file in (path / "__init__.py", path.with_suffix(".py")) if file.is_file()), None)


def versions(step: str = "simulate") -> dict[str, str]:
    """Return the versions of brownpipe and of the packages that compute and write what a step makes."""
    names = (NAME, *PACKAGES, *(() if step == "simulate" else ANALYSIS_PACKAGES))
    return {f"{name}_version": _version(name) for name in names}


@cache
def _version(name: str) -> str:
    from importlib.metadata import PackageNotFoundError, version  # takes 15 ms

    try:
        return version(name)
    except PackageNotFoundError:
        return UNKNOWN
