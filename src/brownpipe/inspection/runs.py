"""The runs of a trajectory file in words: all of them together, or a single one."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from brownpipe.analysis.drift import LEVEL, TOO_FEW, drift_of, in_words, is_tested, quarters_of, time_to_try
from brownpipe.engines.failures import reason_of, stopped_in_words
from brownpipe.engines.state import Ensemble
from brownpipe.errors import RequestError
from brownpipe.inspection.lines import provenance, worst
from brownpipe.observables import ARRAYS
from brownpipe.observables.displacement import displacement
from brownpipe.provenance import modules_of, source_digest
from brownpipe.quoting import shell_path
from brownpipe.scene import Scene
from brownpipe.scene.seeds import brief_seed_text, seed_text
from brownpipe.storage import Trajectories
from brownpipe.storage.layout import described

HEALTH = {  # observable: name of its largest absolute value in the report
    "energy_drift": "worst energy drift",
    "worst_overlap": "worst overlap (sigma)",
    "momentum_residual": "worst momentum residual",
}


def describe_trajectories(path: str | Path, contents: Trajectories) -> list[str]:
    """Return the lines of the report on a trajectory file."""
    ensemble, header = contents.ensemble, contents.header
    runs = len(ensemble.seeds)
    return [
        *_setting(contents),
        f"seeds        {seed_text(ensemble.seeds)} ({runs} {'run' if runs == 1 else 'runs'})",
        _samples(ensemble),
        f"recorded     {_recorded(ensemble)}",
        f"health       {_health(ensemble)}",
        *equilibrium(contents),
        *_statistics(ensemble.observables),
        *_arrays(ensemble),
        *provenance(header, source_digest(*modules_of("simulate", header["engine"]))),
        f"run again    brownpipe inspect {shell_path(path)} --reproduce",
    ]


def describe_run(path: str | Path, contents: Trajectories, seed: int) -> list[str]:
    """Return the lines of the report on the run of one seed. Raises RequestError for a seed that is not in the file."""
    ensemble, column = contents.ensemble, column_of(path, contents.ensemble, seed)
    failed = ensemble.observables["failed"][column] > 0
    lines = [
        f"{path}, seed {seed}",
        *_setting(contents),
        _samples(ensemble),
        f"recorded     {_recorded_of(ensemble, seed)}",
        f"health       {_fate(ensemble, column) if failed else 'passed'}",
    ]
    if seed not in ensemble.stopped:
        lines += [*_tracer(contents.scene, ensemble, column), *_numbers(ensemble.observables, column)]
        lines += _arrays(ensemble, column)
    return lines


def _fate(ensemble: Ensemble, column: int) -> str:
    """Return why a run failed, and what follows."""
    if int(ensemble.seeds[column]) in ensemble.stopped:
        return f"FAILED, left out of every average: {reason_of(ensemble, column)}"
    return "FAILED its health check: left out of every average"


def column_of(path: str | Path, ensemble: Ensemble, seed: int) -> int:
    """Return the index of a seed in the ensemble. Raises RequestError, which lists the seeds, if it is none."""
    columns = np.flatnonzero(ensemble.seeds == seed)
    if not columns.size:
        raise RequestError(f"{path}: --seed {seed}: is not in the file; must be of {brief_seed_text(ensemble.seeds)}")
    return int(columns[0])


def _setting(contents: Trajectories) -> list[str]:
    """Return what was simulated, and by which engine."""
    scene = contents.scene
    box = f"{scene.box.boundary} box {scene.box.width:g} x {scene.box.height:g}"
    return [
        f"scene        {scene.name}: {scene.particles} disks in a {box}, packing fraction {scene.packing_fraction:.4g}",
        f"engine       {contents.engine.options}",
    ]


def _samples(ensemble: Ensemble) -> str:
    return f"samples      {len(ensemble.times)} from t = {ensemble.times[0]:g} to {ensemble.times[-1]:g}"


def _recorded(ensemble: Ensemble) -> str:
    """Return whose tracks, and whether collisions, are in the file."""
    parts = [] if ensemble.tracer is None else ["positions of the tracer"]
    parts += [f"all disks (seeds {seed_text(sorted(ensemble.whole))})"] if ensemble.whole else []
    parts += [f"every collision (seeds {seed_text(sorted(ensemble.events))})"] if ensemble.events else []
    return "; ".join(parts or ["no trajectories"])


def _recorded_of(ensemble: Ensemble, seed: int) -> str:
    """Return for track, whole track and collisions of one run whether they are in the file."""
    collisions = f"yes, {len(ensemble.events[seed].time)}" if seed in ensemble.events else "no"
    tracer = "no" if ensemble.tracer is None else "yes"
    return f"tracer: {tracer}; all disks: {'yes' if seed in ensemble.whole else 'no'}; collisions: {collisions}"


def _health(ensemble: Ensemble) -> str:
    """Return the number of failed runs and, of each error that the engine reports, the largest with its seed."""
    failed = ensemble.failed_seeds
    count = f"{failed.size} failed {'run' if failed.size == 1 else 'runs'}"
    parts = [f"{count} ({seeds_in_words(failed)})" if failed.size else count]
    if ensemble.stopped:
        parts.append(stopped_in_words(ensemble.stopped))
    complete = ~np.isin(ensemble.seeds, list(ensemble.stopped))
    for name, words in HEALTH.items():
        if name in ensemble.observables:
            parts.append(f"{words} {worst(ensemble.observables[name][complete], ensemble.seeds[complete])}")
    return "; ".join(parts)


def equilibrium(contents: Trajectories) -> list[str]:
    """Return whether the runs drift, if their scene claims to be in equilibrium from t = 0."""
    scene, ensemble = contents.scene, contents.ensemble
    if not is_tested(scene, contents.engine):
        return []
    kept = {name: values[ensemble.observables["failed"] == 0] for name, values in ensemble.observables.items()}
    found = drift_of(quarters_of(scene, ensemble.times, kept))
    words = in_words(found, time_to_try(scene)) or f"no drift found (family-wise level {LEVEL:.0%})"
    return [f"equilibrium  {words if np.isfinite(found.p).any() else TOO_FEW}"]


def seeds_in_words(seeds: Sequence[int] | np.ndarray) -> str:
    """Return `seed 7` or `seeds 3-5,9`; a long list is cut."""
    return f"{'seed' if len(seeds) == 1 else 'seeds'} {brief_seed_text(seeds)}"


def _statistics(observables: dict[str, np.ndarray]) -> Iterator[str]:
    """Yield a table of the observables with one number per run, over the runs that did not fail."""
    yield f"{'per run':<22} {'mean':>12} {'min':>12} {'max':>12}"
    for name, values in observables.items():
        if name in ARRAYS or name == "failed":
            continue
        values = values[observables["failed"] == 0]
        if values.size:
            yield f"  {name:<20} {np.mean(values):12.6g} {np.min(values):12.6g} {np.max(values):12.6g}"


def _tracer(scene: Scene, ensemble: Ensemble, column: int) -> Iterator[str]:
    """Yield where the tracer of a run was at the first and the last sample, and its squared displacement."""
    if ensemble.tracer is None:
        return
    track = ensemble.tracer
    position, image = (None if values is None else values[:, [column]] for values in (track.position, track.image))
    moved = displacement(position, image, (scene.box.width, scene.box.height))[-1, 0]
    first, last = (f"({x:.6g}, {y:.6g})" for x, y in position[[0, -1], 0])
    yield f"tracer       from {first} at t = {ensemble.times[0]:g} to {last} at t = {ensemble.times[-1]:g}"
    unwrapped = "" if image is None else ", images crossed included"
    yield f"displaced    by ({moved[0]:.6g}, {moved[1]:.6g}){unwrapped}; squared displacement {np.sum(moved**2):.6g}"


def _numbers(observables: dict[str, np.ndarray], column: int) -> Iterator[str]:
    """Yield a table of the numbers that belong to one run, with units and meaning."""
    yield "numbers of this run"
    for name, values in observables.items():
        if name not in ARRAYS and name != "failed":
            units, long_name = described(name).values()
            yield f"  {name:<20} {values[column]:12.6g} {units:<16} {long_name}".rstrip()


def _arrays(ensemble: Ensemble, column: int | None = None) -> list[str]:
    """Return a heading and, for each array, a line with its name, meaning and shape; nothing if there are none.

    The lines of a single run end with the value, for arrays over time that at the last sample.
    """
    arrays = {name: values for name, values in ensemble.observables.items() if name in ARRAYS}
    averaged = f" (displacements and autocorrelations: average over {ensemble.average})"
    lines = ["arrays" + (averaged if ensemble.average != "runs" else "")] if arrays else []
    for name, values in arrays.items():
        array = ARRAYS[name]
        sizes = zip(("seed", *array.dims), values.shape, strict=True)
        shape = ", ".join(f"{dim} {size}" for dim, size in sizes if column is None or dim != "seed")
        last = "" if column is None else _last(values[column], array.dims, ensemble.times)
        lines.append(f"  {name:<30} {array.long_name}{f' ({shape})' if shape else ''}{last}")
    return lines


def _last(values: np.ndarray, dims: tuple[str, ...], times: np.ndarray) -> str:
    """Return the value of a number, the last value or values of an array over time; of other arrays nothing."""
    if not dims:
        return f": {values:.6g}"
    if dims[0] != "time":
        return ""
    return f": {', '.join(f'{value:.6g}' for value in np.ravel(values[-1]))} at t = {times[-1]:g}"
