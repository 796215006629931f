"""Run again what made a trajectory file, from the file alone, and compare: `brownpipe inspect FILE
--reproduce`.

The file has the scene, the engine with its settings, the seeds, and what was recorded and measured.
Runs do not depend on their batch, so a single one can be compared, too. The same source, packages
and kind of processor give the same bits.
"""

from pathlib import Path

import numpy as np

from brownpipe.engines import forecast
from brownpipe.engines.ensemble import Ensemble, select
from brownpipe.inspection.reports import DIGITS, runs_of
from brownpipe.observables.own import identity
from brownpipe.provenance import source_digest, versions
from brownpipe.scene import Scene
from brownpipe.scene.seeds import brief_seed_text
from brownpipe.storage.layout import groups_of
from brownpipe.storage.trajectories import Trajectories
from brownpipe.text import counted, in_lines, in_time

Differences = dict[
    str, dict[int, float]
]  # by variable (as in the file) and seed: the `_distance`, unless None


def read_original(path: str | Path, seed: int | None = None) -> Trajectories:
    """Return the runs of a trajectory file, or the run of one seed.

    Raises RequestError for a seed that is not in the file, and for runs that this installation
    refuses or that do not fit into memory; WrongFileError for a dataset, StorageError for a damaged
    file.
    """
    contents = runs_of(path, seed)
    scene, engine, options = contents.scene, contents.engine, _options(contents)
    engine.refuse_unfit(scene, options[0])
    forecast.refuse_too_large(scene, len(contents.ensemble.seeds), engine.forecast(scene, *options))
    return contents


def _options(original: Trajectories) -> tuple[frozenset[str], tuple[str, ...], str]:
    """Return what is recorded, what is measured in each run, and over what that is averaged."""
    return (
        original.record or frozenset({"none"}),
        original.measured or (),
        original.ensemble.average,
    )


def _changes(original: Trajectories) -> str:
    """Return what differs between source and packages that made a file and those of this
    installation, in words.
    """
    here = versions() | {"source": source_digest("simulate", original.engine.name)}
    stored = {name: original.header.get(name, "unknown") for name in here} | {
        "source": original.source
    }
    own = {array.observable: array.source for array in original.ensemble.own.values()}
    here, stored = here | {name: identity(name).rpartition(" ")[2] for name in own}, stored | own
    pairs = (
        (name, stored[name][:DIGITS], here[name][:DIGITS])
        for name in here
        if stored[name] != here[name]
    )
    return "; ".join(
        f"{name.removesuffix('_version')} {before}, here {now}" for name, before, now in pairs
    )


def announcement(original: Trajectories) -> list[str]:
    """Return what will be run, how long it will take, and what may make it differ, as lines of
    text.
    """
    scene, engine, runs = original.scene, original.engine, len(original.ensemble.seeds)
    cost = engine.forecast(scene, *_options(original))
    seconds = forecast.START_UP + cost.once + runs * cost.seconds
    what = f"{counted(runs, 'run')} of {scene.name}, N = {scene.particles}, {engine.options}"
    lines = [f"running again {what}: some {in_time(seconds)} of CPU"]
    if changes := _changes(original):
        lines.append(f"results may differ: the file was made with {changes}")
    return lines


def differences(original: Trajectories) -> Differences:
    """Make the runs again and return the variables that differ, with all that was recorded and
    measured.

    Raises RunError and RequestError like the engine.
    """
    scene, seeds, (record, observables, average) = (
        original.scene,
        original.ensemble.seeds,
        _options(original),
    )
    again = original.engine.simulate(
        scene, seeds.tolist(), record, observables=observables, average=average
    )
    found: Differences = {}
    for seed in seeds.tolist():
        stored, made = (
            _variables(scene, ensemble, seed) for ensemble in (original.ensemble, again)
        )
        for name in stored | made:
            if (distance := _distance(stored.get(name), made.get(name))) is not None:
                found.setdefault(name, {})[seed] = distance
    return found


def _variables(scene: Scene, ensemble: Ensemble, seed: int) -> dict[str, np.ndarray]:
    """Return all variables of a run by their paths in a file; of one that could not go on, that it
    failed and why.
    """
    run = select(ensemble, ensemble.seeds == seed)
    if run.stopped:
        return {"failed": run.observables["failed"], "stopped": np.array([*run.stopped.values()])}
    groups = groups_of(scene, run).items()
    return {
        f"{path}/{name}".lstrip("/"): values
        for path, group in groups
        for name, values in group.items()
    }


def _distance(one: np.ndarray | None, other: np.ndarray | None) -> float | None:
    """Return the largest absolute difference of two arrays, None if they are bit-identical.

    NaN if shapes or types differ, or where one of them is NaN.
    """
    if one is None or other is None or one.dtype != other.dtype or one.shape != other.shape:
        return np.nan
    if one.tobytes() == other.tobytes():
        return None
    if one.dtype.kind == "U":
        return np.nan
    differing = (one != other) & ~(np.isnan(one) & np.isnan(other))
    moved = np.abs(one[differing].astype(float) - other[differing].astype(float))
    return float(np.max(moved, initial=0.0))


def verdict(original: Trajectories, found: Differences) -> str:
    """Return whether all variables are bit-identical or, for each that is not, its runs and by how
    much they differ.
    """
    runs = counted(len(original.ensemble.seeds), "run")
    if not found:
        return f"identical: {runs}, all variables bit-identical"
    lines = [f"different: {len(set().union(*found.values()))} of {runs}"]
    for name, sizes in found.items():
        largest = np.max([*sizes.values()])
        size = "in shape, type or NaN" if np.isnan(largest) else f"by at most {largest:.2g}"
        lines.append(
            f"  {name}: {size} ({'seed' if len(sizes) == 1 else 'seeds'} "
            f"{brief_seed_text([*sizes])})"
        )
    return in_lines(lines)
