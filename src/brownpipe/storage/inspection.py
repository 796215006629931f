"""Contents and integrity of a trajectory file or dataset: `brownpipe inspect`."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.engines.state import Ensemble
from brownpipe.errors import StorageError, WrongFileError
from brownpipe.observables import ARRAYS
from brownpipe.provenance import simulation_of, source_digest
from brownpipe.scene.seeds import seed_text
from brownpipe.storage import arrays
from brownpipe.storage.datasets import read_dataset
from brownpipe.storage.trajectories import Trajectories, read_header, read_trajectories

if TYPE_CHECKING:
    import xarray

HEALTH = {  # observable: name of its largest absolute value in the report
    "energy_drift": "worst energy drift",
    "worst_overlap": "worst overlap (sigma)",
    "momentum_residual": "worst momentum residual",
}


def verify(path: str | Path) -> list[str]:
    """Return the problems of a trajectory file or dataset, one line each; empty if it is intact.

    Raises WrongFileError if it is neither.
    """
    try:
        _read(path)
    except WrongFileError:
        raise
    except StorageError as error:
        return [str(error)]
    return []


def report(path: str | Path) -> str:
    """Return what a trajectory file or dataset contains, as lines of text; one line if it is damaged."""
    try:
        contents = _read(path)
    except StorageError as error:
        return f"NOT INTACT  {error}"
    lines = _trajectories(path, contents) if isinstance(contents, Trajectories) else _dataset(contents)
    size = f"{Path(path).stat().st_size / 1e6:.2f} MB"
    return "\n".join([f"{path}  {size}", *lines, "intact       yes: every byte as it was written"])


def _read(path: str | Path) -> "Trajectories | xarray.Dataset":
    """Return the contents of a file of either kind.

    The extension decides which kind is tried first, and so which command a message about a damaged file names.
    """
    readers: list[Callable[[str | Path], Trajectories | xarray.Dataset]] = [read_trajectories, read_dataset]
    first, second = readers[::-1] if Path(path).suffix == ".nc" else readers
    try:
        return first(path)
    except WrongFileError:
        return second(path)


def _trajectories(path: str | Path, contents: Trajectories) -> list[str]:
    scene, engine, ensemble = contents[:3]
    times, runs = ensemble.times, len(ensemble.seeds)
    box = f"{scene.box.boundary} box {scene.box.width:g} x {scene.box.height:g}"
    return [
        f"scene        {scene.name}: {scene.particles} disks in a {box}, packing fraction {scene.packing_fraction:.4g}",
        f"engine       {engine.options}",
        f"seeds        {seed_text(ensemble.seeds)} ({runs} {'run' if runs == 1 else 'runs'})",
        f"samples      {len(times)} from t = {times[0]:g} to {times[-1]:g}",
        f"recorded     {_recorded(ensemble)}",
        _health(ensemble.observables),
        *_statistics(ensemble.observables),
        *arrays.listing(ensemble),
        *_provenance(read_header(path)),
    ]


def _recorded(ensemble: Ensemble) -> str:
    """Return whose tracks, and whether collisions, are in the file."""
    parts = [] if ensemble.tracer is None else ["positions of the tracer"]
    parts += [f"all disks (seeds {seed_text(sorted(ensemble.whole))})"] if ensemble.whole else []
    parts += [f"every collision (seeds {seed_text(sorted(ensemble.events))})"] if ensemble.events else []
    return "; ".join(parts or ["no trajectories"])


def _health(observables: dict[str, np.ndarray]) -> str:
    """Return the number of failed runs, and the largest errors of all runs that the engine reports."""
    worst = {name: np.max(np.abs(observables[name]), initial=0.0) for name in HEALTH if name in observables}
    failed = int(np.sum(observables["failed"]))
    return f"health       {failed} failed runs" + "".join(f"; {HEALTH[name]} {worst[name]:.2g}" for name in worst)


def _statistics(observables: dict[str, np.ndarray]) -> Iterator[str]:
    """Yield a table of the observables with one number per run, over the runs that did not fail."""
    yield f"{'per run':<22} {'mean':>12} {'min':>12} {'max':>12}"
    for name, values in observables.items():
        if name in ARRAYS or name == "failed":
            continue
        values = values[observables["failed"] == 0]
        if values.size:
            yield f"  {name:<20} {np.mean(values):12.6g} {np.min(values):12.6g} {np.max(values):12.6g}"


def _provenance(header: dict) -> list[str]:
    """Return versions and digests, and whether this installation would run the same source."""
    names = ("brownpipe", "numpy", "numba", "h5py")
    now = source_digest(simulation_of(header["engine"]))
    source = "that of this installation" if header["source_digest"] == now else "not that of this installation"
    return [
        "written by   " + ", ".join(f"{name} {header[f'{name}_version']}" for name in names),
        f"source       {header['source_digest'][:12]}, {source}",
        f"contents     {header['contents_digest'][:12]}",
    ]


def _dataset(dataset: "xarray.Dataset") -> list[str]:
    sizes = ", ".join(f"{name} {size}" for name, size in dataset.sizes.items())
    return [
        f"title        {dataset.attrs.get('title', '-')}",
        f"dimensions   {sizes}",
        f"variables    {', '.join(map(str, dataset.data_vars))}",
    ]
