"""What results are made with: the source code and the package versions that decide them. Imports nothing heavy."""

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).parent
# The modules and packages that decide the trajectories of the exact engine, and what is measured in its runs.
SOURCES = (
    "reading",
    "packing",
    "sampling",
    "scene",
    "placement",
    "state",
    "theory",
    "collisions",
    "kernels",
    "inlining",
    "records",
    "observables",
    "batch",
    "exact",
)
ENGINES = {  # the others equilibrate by the exact one, or measure with it
    "exact": SOURCES,
    "timestep": (*SOURCES, "timestep"),
    "langevin": (*SOURCES, "friction", "langevin"),
}


class Step(NamedTuple):
    """What decides the outcome of a step of the pipeline, besides what the step is given."""

    sources: tuple[str, ...]  # modules and packages of brownpipe
    packages: tuple[str, ...]


STEPS = {
    "simulate": Step(("storage",), ("numpy", "numba", "h5py")),  # and the engine
    "aggregate": Step(
        ("storage", "observables", "analysis", "theory", "friction"), ("numpy", "scipy", "xarray", "h5py")
    ),
    "tradeoff": Step(("storage", "analysis", "tradeoff"), ("numpy", "scipy", "xarray", "h5py")),
    "tradeoff_figures": Step(("figures", "tradeoff", "analysis", "storage"), ("numpy", "matplotlib")),
    "figures": Step(("figures", "analysis", "storage", "theory"), ("numpy", "matplotlib")),
}


def made_with(step: str, engine: str | None = None) -> dict[str, str]:
    """The digest of a step's source and the versions of its packages: when one of them changes, it is run again.

    The source of the engine is part of the step that runs it.
    """
    sources, packages = STEPS[step]
    source = source_digest(PACKAGE, (*ENGINES.get(engine, ()), *sources))
    return {"source": source} | {name: _version(name) for name in packages}


def source_digest(folder: Path = PACKAGE, sources: tuple[str, ...] = SOURCES) -> str:
    """The sha256 over the source text of everything that decides trajectories; line ends do not count.

    Raises FileNotFoundError for a source that is neither a module nor a package.
    """
    total = hashlib.sha256()
    for file in (file for name in sources for file in _files(folder, name)):
        text = file.read_text(encoding="utf-8").encode()
        total.update(f"{file.relative_to(folder).as_posix()} {len(text)}\n".encode())
        total.update(text)
    return total.hexdigest()


def _files(folder, name):
    files = sorted((folder / name).rglob("*.py")) or [folder / f"{name}.py"]
    if not files[0].is_file():
        raise FileNotFoundError(f"{folder / name}: neither a module nor a package")
    return files


@cache
def versions() -> dict[str, str]:
    """Versions of brownpipe and of the packages that decide its numbers and its files."""
    return {f"{name}_version": _version(name) for name in ("brownpipe", "numpy", "numba", "h5py")}


def _version(name):
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"
