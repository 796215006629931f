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
from brownpipe.inspection.reports import DIGITS, read_runs
from brownpipe.observables.own import identity
from brownpipe.provenance import source_digest, versions
from brownpipe.scene import Scene
from brownpipe.scene.seeds import brief_seed_text
from brownpipe.storage.layout import variables_by_group
from brownpipe.storage.trajectories import Trajectories
from brownpipe.text import counted, in_lines, in_time

# By variable (as in the file) and seed: the `_distance`, unless None
Differences = dict[str, dict[int, float]]


def read_original(path: str | Path, seed: int | None = None) -> Trajectories:
    """Return the runs of a trajectory file, or the run of one seed.

    Raises RequestError for a seed that is not in the file, and for runs that this installation
    refuses or that do not fit into memory; WrongFileError for a dataset, StorageError for a damaged
    file.
    """
    contents = read_runs(path, seed)
    scene = contents.scene
    engine = contents.engine
    record, observables, average = _options(contents)
    engine.refuse_unfit(scene, record)
    cost = engine.forecast(scene, record, observables, average)
    forecast.refuse_too_large(scene, len(contents.ensemble.seeds), cost)
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
    here = versions()
    stored = {name: original.header.get(name, "unknown") for name in here}
    here["source"] = source_digest("simulate", original.engine.name)
    stored["source"] = original.source
    for array in original.ensemble.own.values():
        if not array.observable:  # a coordinate
            continue
        here[array.observable] = identity(array.observable).rpartition(" ")[2]
        stored[array.observable] = array.source
    changes = []
    for name, now in here.items():
        before = stored[name]
        if before != now:
            what = name.removesuffix("_version")
            changes.append(f"{what} {before[:DIGITS]}, here {now[:DIGITS]}")
    return "; ".join(changes)


def announcement(original: Trajectories) -> list[str]:
    """Return what will be run, how long it will take, and what may make it differ, as lines of
    text.
    """
    scene = original.scene
    engine = original.engine
    number = len(original.ensemble.seeds)
    cost = engine.forecast(scene, *_options(original))
    seconds = forecast.START_UP + cost.seconds_per_process + number * cost.seconds
    runs = f"{counted(number, 'run')} of {scene.title}, {engine.options}"
    lines = [f"running again {runs}: some {in_time(seconds)} of CPU"]
    if changes := _changes(original):
        lines.append(f"results may differ: the file was made with {changes}")
    return lines


def differing_variables(original: Trajectories) -> Differences:
    """Make the runs again and return the variables that differ, with all that was recorded and
    measured.

    Raises RunError and RequestError like the engine.
    """
    scene = original.scene
    seeds = original.ensemble.seeds.tolist()
    record, observables, average = _options(original)
    reproduced = original.engine.simulate(
        scene, seeds, record, observables=observables, average=average
    )
    distances: Differences = {}
    for seed in seeds:
        stored = _variables_of_run(scene, original.ensemble, seed)
        repeated = _variables_of_run(scene, reproduced, seed)
        for name in stored | repeated:
            distance = _distance(stored.get(name), repeated.get(name))
            if distance is not None:
                distances.setdefault(name, {})[seed] = distance
    return distances


def _variables_of_run(scene: Scene, ensemble: Ensemble, seed: int) -> dict[str, np.ndarray]:
    """Return all variables of a run by their paths in a file; of one that could not go on, that it
    failed and why.
    """
    run = select(ensemble, ensemble.seeds == seed)
    if run.stopped:
        return {"failed": run.observables["failed"], "stopped": np.array([*run.stopped.values()])}
    variables = {}
    for path, group in variables_by_group(scene, run).items():
        for name, values in group.items():
            variables[f"{path}/{name}".lstrip("/")] = values
    return variables


def _distance(stored: np.ndarray | None, repeated: np.ndarray | None) -> float | None:
    """Return the largest absolute difference of two arrays, None if they are bit-identical.

    NaN if shapes or types differ, or where one of them is NaN.
    """
    if stored is None or repeated is None:
        return np.nan
    if stored.dtype != repeated.dtype or stored.shape != repeated.shape:
        return np.nan
    if stored.tobytes() == repeated.tobytes():
        return None
    if stored.dtype.kind == "U":
        return np.nan
    both_nan = np.isnan(stored) & np.isnan(repeated)
    differing = (stored != repeated) & ~both_nan
    before = stored[differing].astype(float)
    now = repeated[differing].astype(float)
    return float(np.max(np.abs(before - now), initial=0.0))


def comparison_in_words(original: Trajectories, distances: Differences) -> str:
    """Return whether all variables are bit-identical or, for each that is not, its runs and by how
    much they differ.
    """
    runs = counted(len(original.ensemble.seeds), "run")
    if not distances:
        return f"identical: {runs}, all variables bit-identical"
    differing = set().union(*distances.values())
    lines = [f"different: {len(differing)} of {runs}"]
    for name, distance_by_seed in distances.items():
        largest = np.max([*distance_by_seed.values()])
        size = "in shape, type or NaN" if np.isnan(largest) else f"by at most {largest:.2g}"
        word = "seed" if len(distance_by_seed) == 1 else "seeds"
        lines.append(f"  {name}: {size} ({word} {brief_seed_text([*distance_by_seed])})")
    return in_lines(lines)
