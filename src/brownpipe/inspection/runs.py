"""The runs of a trajectory file in words."""

from collections.abc import Iterator

import numpy as np

from brownpipe.analysis.drift import LEVEL, TOO_FEW, drift_of, in_words, is_tested, quarters_of, time_to_try
from brownpipe.engines.ensemble import HEALTH, Ensemble, failures
from brownpipe.figures.tables import aligned
from brownpipe.formatting import counted
from brownpipe.observables.displacement import displacement
from brownpipe.scene import Scene
from brownpipe.scene.seeds import seed_text
from brownpipe.storage.layout import described, dims_of
from brownpipe.storage.trajectories import Trajectories


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


def lines(contents: Trajectories) -> list[str]:
    """Return the lines of the report on the runs of a trajectory file."""
    scene, engine, ensemble, *_ = contents
    times, box = ensemble.times, scene.box
    size, phi = f"{box.boundary} box {box.width:g} x {box.height:g}", scene.packing_fraction
    return [
        f"scene        {scene.name}: {scene.particles} disks in a {size}, packing fraction {phi:.4g}",
        f"engine       {engine.options}",
        f"seeds        {seed_text(ensemble.seeds)} ({counted(len(ensemble.seeds), 'run')})",
        f"samples      {len(times)} from t = {times[0]:g} to {times[-1]:g}",
        f"recorded     {', '.join(sorted(contents.outline.record)) or 'none'}",
        f"averages     over {ensemble.average}",
        f"health       {_health(ensemble)}",
        *equilibrium(contents),
        *_tracer(scene, ensemble),
    ]


def _health(ensemble: Ensemble) -> str:
    """Return which runs failed and, of each reported error, the largest with its seed; NaN is largest."""
    parts = [failures(ensemble) or "no failed runs"]
    complete = ~np.isin(ensemble.seeds, list(ensemble.stopped))
    for name in (name for name in HEALTH if name in ensemble.observables and complete.any()):
        sizes = np.abs(ensemble.observables[name][complete])
        seed = f" (seed {ensemble.seeds[complete][np.argmax(sizes)]})" if np.max(sizes) else ""
        parts.append(f"worst {name.removeprefix('worst_').replace('_', ' ')} {np.max(sizes):.2g}{seed}")
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


def _tracer(scene: Scene, ensemble: Ensemble) -> Iterator[str]:
    """Yield how far the tracer of a single run moved from the first to the last sample."""
    if ensemble.tracer is None or len(ensemble.seeds) > 1 or ensemble.stopped:
        return
    position, _, image = ensemble.tracer
    moved = displacement(position, image, (scene.box.width, scene.box.height))[-1, 0]
    yield f"displaced    by ({moved[0]:.6g}, {moved[1]:.6g}); squared displacement {np.sum(moved**2):.6g}"


def table(ensemble: Ensemble) -> list[str]:
    """Return a table of all observables: mean, min and max of the runs that did not fail, or that of one run.

    Of arrays it has the dimensions instead.
    """
    several, shown = len(ensemble.seeds) > 1, ensemble.observables["failed"] == 0
    shown = shown if several else np.array([not ensemble.stopped])
    columns = ("mean", "min", "max") if several else ("value",)
    rows: list[tuple[str, ...]] = [("observable", *(f"{name:>12}" for name in columns), "units", "meaning")]
    for name in sorted(ensemble.observables.keys() - {"failed"}):
        values, numbers = ensemble.observables[name], ["", "", ""]
        units, meaning = list(described(name, ensemble.own).values())[:2]
        if values.ndim > 1:
            sizes = zip(dims_of("/", name, ensemble.own), values.shape, strict=True)
            meaning += f" ({', '.join(f'{dim} {size}' for dim, size in sizes)})"
        elif shown.any():
            numbers = [f"{of(values[shown]):12.6g}" for of in (np.mean, np.min, np.max)]
        rows.append((name, *numbers[: len(columns)], units, meaning))
    return aligned([*zip(*rows, strict=True)])
