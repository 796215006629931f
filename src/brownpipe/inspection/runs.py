"""The runs of a trajectory file in words."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from brownpipe.analysis.drift import LEVEL, TOO_FEW, drift_of, in_words, is_tested, quarters_of, time_to_try
from brownpipe.engines.ensemble import Ensemble, stopped_in_words
from brownpipe.errors import RequestError
from brownpipe.formatting import counted
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


def only(path: str | Path, contents: Trajectories, seed: int) -> Trajectories:
    """Return the run of one seed. Raises RequestError, which lists the seeds, if it is not among them."""
    ensemble = contents.ensemble
    if seed not in ensemble.seeds:
        raise RequestError(f"{path}: --seed {seed}: is not in the file; must be of {brief_seed_text(ensemble.seeds)}")
    return contents._replace(ensemble=run_of(ensemble, seed))


def run_of(ensemble: Ensemble, seed: int) -> Ensemble:
    """Return the run of one seed as an ensemble of its own."""
    column = ensemble.seeds == seed
    return ensemble._replace(
        seeds=ensemble.seeds[column],
        tracer=ensemble.tracer and ensemble.tracer.of(column),
        observables={name: values[column] for name, values in ensemble.observables.items()},
        whole={one: track for one, track in ensemble.whole.items() if one == seed},
        events={one: log for one, log in ensemble.events.items() if one == seed},
        stopped={one: reason for one, reason in ensemble.stopped.items() if one == seed},
    )


def describe_trajectories(path: str | Path, contents: Trajectories) -> list[str]:
    """Return the lines of the report on the runs of a trajectory file; of a single one it says more."""
    scene, engine, ensemble, _, header = contents
    times, box = ensemble.times, scene.box
    size, phi = f"{box.boundary} box {box.width:g} x {box.height:g}", scene.packing_fraction
    return [
        f"scene        {scene.name}: {scene.particles} disks in a {size}, packing fraction {phi:.4g}",
        f"engine       {engine.options}",
        f"seeds        {seed_text(ensemble.seeds)} ({counted(len(ensemble.seeds), 'run')})",
        f"samples      {len(times)} from t = {times[0]:g} to {times[-1]:g}",
        f"recorded     {_recorded(ensemble)}",
        f"health       {_health(ensemble)}",
        *equilibrium(contents),
        *_tracer(scene, ensemble),
        *_numbers(ensemble),
        *_arrays(ensemble),
        *provenance(header, source_digest(*modules_of("simulate", engine.name))),
        f"run again    brownpipe inspect {shell_path(path)} --reproduce",
    ]


def _recorded(ensemble: Ensemble) -> str:
    """Return whose tracks, and whether collisions, are in the file."""
    collisions = counted(sum(len(log.time) for log in ensemble.events.values()), "collision")
    parts = [] if ensemble.tracer is None else ["positions of the tracer"]
    parts += [f"all disks ({seeds_in_words(sorted(ensemble.whole))})"] if ensemble.whole else []
    parts += [f"{collisions} ({seeds_in_words(sorted(ensemble.events))})"] if ensemble.events else []
    return "; ".join(parts or ["no trajectories"])


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


def _tracer(scene: Scene, ensemble: Ensemble) -> Iterator[str]:
    """Yield how far the tracer of a single run moved from the first to the last sample."""
    if ensemble.tracer is None or len(ensemble.seeds) > 1 or ensemble.stopped:
        return
    position, _, image = ensemble.tracer
    moved = displacement(position, image, (scene.box.width, scene.box.height))[-1, 0]
    yield f"displaced    by ({moved[0]:.6g}, {moved[1]:.6g}); squared displacement {np.sum(moved**2):.6g}"


def _numbers(ensemble: Ensemble) -> Iterator[str]:
    """Yield a table of the observables with one number per run: of those that did not fail, or of a single run."""
    names = [name for name in ensemble.observables if name not in ARRAYS and name != "failed"]
    kept = ensemble.observables["failed"] == 0
    if len(kept) > 1:
        yield f"{'per run':<22} {'mean':>12} {'min':>12} {'max':>12}"
    for name in names:
        values = ensemble.observables[name]
        if len(kept) > 1 and kept.any():
            numbers = values[kept]
            yield f"  {name:<20} {np.mean(numbers):12.6g} {np.min(numbers):12.6g} {np.max(numbers):12.6g}"
        elif len(kept) == 1 and not ensemble.stopped:
            units, meaning = described(name).values()
            yield f"  {name:<20} {values[0]:12.6g} {units:<16} {meaning}"


def _arrays(ensemble: Ensemble) -> list[str]:
    """Return a heading and, for each array, a line with its name, meaning and shape; nothing if there are none."""
    arrays = {name: values for name, values in ensemble.observables.items() if name in ARRAYS}
    averaged = f" (displacements and autocorrelations: average over {ensemble.average})"
    lines = ["arrays" + (averaged if ensemble.average != "runs" else "")] if arrays else []
    for name, values in arrays.items():
        sizes = zip(("seed", *ARRAYS[name].dims), values.shape, strict=True)
        shape = ", ".join(f"{dim} {size}" for dim, size in sizes)
        lines.append(f"  {name:<30} {ARRAYS[name].long_name} ({shape})")
    return lines
