"""What is in a file, and is it intact: `brownpipe inspect`."""

from pathlib import Path

import numpy as np

from brownpipe.errors import StorageError, WrongFileError
from brownpipe.observables import ARRAYS
from brownpipe.provenance import simulation_of, source_digest
from brownpipe.scene.seeds import seed_text
from brownpipe.storage import arrays
from brownpipe.storage.datasets import read_dataset
from brownpipe.storage.trajectories import Trajectories, read_header, read_trajectories


def verify(path: str | Path) -> list[str]:
    """The problems of a trajectory file or of a dataset, one line each; none if it is intact.

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
    """What the file at `path` holds, as text for people; one line if it cannot be trusted."""
    try:
        contents = _read(path)
    except StorageError as error:
        return f"NOT INTACT  {error}"
    report_on = _trajectories if isinstance(contents, Trajectories) else _dataset
    size = f"{Path(path).stat().st_size / 1e6:.2f} MB"
    lines = [f"{path}  {size}", *report_on(path, contents), "intact       yes: every byte as it was written"]
    return "\n".join(lines)


def _read(path):
    """What the file holds, whatever its name; the name decides how to make a broken one again."""
    readers = [read_trajectories, read_dataset]
    first, second = readers[::-1] if Path(path).suffix == ".nc" else readers
    try:
        return first(path)
    except WrongFileError:
        return second(path)


def _trajectories(path, contents):
    scene, engine, ensemble = contents[:3]
    times = ensemble.times
    box = f"{scene.box.boundary} box {scene.box.width:g} x {scene.box.height:g}"
    return [
        f"scene        {scene.name}: {scene.particles} disks in a {box}, packing fraction {scene.packing_fraction:.4g}",
        f"engine       {engine.options}",
        f"seeds        {seed_text(ensemble.seeds)} ({len(ensemble.seeds)} runs)",
        f"samples      {len(times)} from t = {times[0]:g} to {times[-1]:g}",
        f"recorded     {_recorded(ensemble)}",
        *_health(ensemble.observables),
        *_statistics(ensemble.observables),
        *arrays.listing(ensemble),
        *_origin(read_header(path)),
    ]


def _recorded(ensemble):
    tracer = "tracer positions" if ensemble.tracer is not None else "no tracer"
    return f"{tracer}, {len(ensemble.whole)} whole runs, every collision of {len(ensemble.events)} runs"


def _health(observables):
    worst = {name: np.max(np.abs(observables[name]), initial=0.0) for name in _HEALTH if name in observables}
    failed = int(np.sum(observables["failed"]))
    return [f"health       {failed} failed runs" + "".join(f"; {_HEALTH[name]} {worst[name]:.2g}" for name in worst)]


_HEALTH = {
    "energy_drift": "worst energy drift",
    "worst_overlap": "worst overlap (sigma)",
    "momentum_residual": "worst momentum residual",
}


def _statistics(observables):
    """A table of the runs that did not fail."""
    yield f"{'observables':<22} {'mean':>12} {'min':>12} {'max':>12}"
    numbers = {name: value for name, value in observables.items() if name not in ARRAYS}
    for name, value in numbers.items():
        value = value[observables["failed"] == 0]
        if value.size and name != "failed":
            yield f"  {name:<20} {np.mean(value):12.6g} {np.min(value):12.6g} {np.max(value):12.6g}"


def _origin(header):
    names = ("brownpipe", "numpy", "numba", "h5py")
    now = source_digest(simulation_of(header["engine"]))
    source = "as in this brownpipe" if header["source_digest"] == now else "not that of this brownpipe"
    return [
        "written by   " + ", ".join(f"{name} {header[f'{name}_version']}" for name in names),
        f"source       {header['source_digest'][:12]}, {source}",
        f"contents     {header['contents_digest'][:12]}",
    ]


def _dataset(path, dataset):
    sizes = ", ".join(f"{name} {size}" for name, size in dataset.sizes.items())
    return [
        f"title        {dataset.attrs.get('title', '-')}",
        f"dimensions   {sizes}",
        f"variables    {', '.join(map(str, dataset.data_vars))}",
    ]
