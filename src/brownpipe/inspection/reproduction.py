"""Run again what made a trajectory file, from the file alone, and compare: `brownpipe inspect FILE --reproduce`.

The file has the scene, the engine with its settings, the seeds, and what was recorded and measured. Runs do not depend
on their batch, so a single one can be compared, too. The same source, packages and kind of processor give the same
bits.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.engines import Engine, forecast
from brownpipe.engines.state import Ensemble, Events, Track
from brownpipe.formatting import counted, in_time
from brownpipe.inspection import trajectories_of
from brownpipe.inspection.lines import DIGITS
from brownpipe.inspection.runs import column_of, seeds_in_words
from brownpipe.provenance import modules_of, source_digest, versions
from brownpipe.quoting import in_lines
from brownpipe.scene import Scene


class Original(NamedTuple):
    """Runs of a trajectory file, and all that is needed to make them again."""

    scene: Scene
    engine: Engine
    ensemble: Ensemble  # of the file
    seeds: tuple[int, ...]  # of the runs that are made again
    record: frozenset[str]
    observables: tuple[str, ...]
    changes: tuple[str, ...]  # source and versions that differ from those of this installation, in words


class Difference(NamedTuple):
    """An array that is not bit-identical in some runs."""

    name: str  # as in the file; of tracks and collisions with whose they are
    seeds: list[int]
    largest: float  # absolute difference of two elements; NaN if shapes or types differ, or if one of them is NaN


def read_original(path: str | Path, seed: int | None = None) -> Original:
    """Return the runs of a trajectory file, or the run of one seed.

    Raises RequestError for a seed that is not in the file, and for runs that this installation refuses or that do not
    fit into memory; WrongFileError for a dataset, StorageError for a damaged file.
    """
    contents = trajectories_of(path, "--reproduce")
    scene, engine, ensemble, _, header = contents
    seeds = ensemble.seeds if seed is None else ensemble.seeds[[column_of(path, ensemble, seed)]]
    outline = contents.outline
    record, observables = outline.record or frozenset({"none"}), outline.observables or ()
    engine.refuse_unfit(scene, record)
    forecast.refuse_too_large(scene, len(seeds), engine.forecast(scene, record, observables, ensemble.average))
    return Original(scene, engine, ensemble, tuple(seeds.tolist()), record, observables, _changes(header))


def _changes(header: Mapping[str, str]) -> tuple[str, ...]:
    """Return what differs between source and packages that made a file and those of this installation."""
    here = versions() | {"source": source_digest(*modules_of("simulate", header["engine"]))}
    stored = {name: header.get(name, "unknown") for name in here} | {"source": header["source_digest"]}
    pairs = ((name, stored[name][:DIGITS], here[name][:DIGITS]) for name in here if stored[name] != here[name])
    return tuple(f"{name.removesuffix('_version')} {before}, here {now}" for name, before, now in pairs)


def announcement(original: Original) -> list[str]:
    """Return what will be run, how long it will take, and what may make it differ, as lines of text."""
    scene, runs = original.scene, counted(len(original.seeds), "run")
    cost = original.engine.forecast(scene, original.record, original.observables, original.ensemble.average)
    seconds = forecast.START_UP + cost.once + len(original.seeds) * cost.seconds
    what = f"{runs} of {scene.name}, N = {scene.particles}, {original.engine.options}"
    lines = [f"running again {what}: some {in_time(seconds)} of CPU"]
    if original.changes:
        lines.append(f"results may differ: the file was made with {'; '.join(original.changes)}")
    return lines


def differences(original: Original) -> list[Difference]:
    """Make the runs again and return the arrays that differ, with sample times and all that was recorded and measured.

    Raises RunError and RequestError like the engine.
    """
    scene, engine, before = original.scene, original.engine, original.ensemble
    observables, average = original.observables, before.average
    again = engine.simulate(scene, original.seeds, original.record, observables=observables, average=average)
    sizes: dict[str, dict[int, float]] = {}  # array: {seed: largest difference}
    for column, seed in enumerate(original.seeds):
        stored = _arrays(before, int(np.flatnonzero(before.seeds == seed)[0]))
        made = _arrays(again, column)
        for name in stored | made:
            distance = _distance(stored.get(name), made.get(name))
            if distance is not None:
                sizes.setdefault(name, {})[seed] = distance
    return [Difference(name, sorted(found), float(np.max(list(found.values())))) for name, found in sizes.items()]


def _arrays(ensemble: Ensemble, column: int) -> dict[str, np.ndarray]:
    """Return all arrays of one run by name; of a run that could not go on, only that it failed."""
    seed = int(ensemble.seeds[column])
    if seed in ensemble.stopped:
        return {"sample times": ensemble.times, "failed": ensemble.observables["failed"][column]}
    records: dict[str, Track | Events | None] = {
        "of the tracer": ensemble.tracer and ensemble.tracer.of(column),
        "of all disks": ensemble.whole.get(seed),
        "of the collisions": ensemble.events.get(seed),
    }
    arrays = {"sample times": ensemble.times}
    arrays |= {name: np.asarray(values[column]) for name, values in ensemble.observables.items()}
    for whose, record in records.items():
        fields = {} if record is None else record._asdict()
        arrays |= {f"{name} {whose}": values for name, values in fields.items() if values is not None}
    return arrays


def _distance(one: np.ndarray | None, other: np.ndarray | None) -> float | None:
    """Return the largest absolute difference of two arrays, None if they are bit-identical.

    NaN if shapes or types differ, or where one of them is NaN.
    """
    if one is None or other is None or one.dtype != other.dtype or one.shape != other.shape:
        return np.nan
    if one.tobytes() == other.tobytes():
        return None
    differing = (one != other) & ~(np.isnan(one) & np.isnan(other))
    moved = np.abs(one[differing].astype(float) - other[differing].astype(float))
    return float(np.max(moved, initial=0.0))


def verdict(original: Original, found: list[Difference]) -> str:
    """Return whether all arrays are bit-identical or, for each that is not, its runs and by how much they differ."""
    runs = counted(len(original.seeds), "run")
    if not found:
        return f"identical: {runs}, all arrays bit-identical"
    differing = {seed for difference in found for seed in difference.seeds}
    lines = [f"different: {len(differing)} of {runs}"]
    for name, seeds, largest in found:
        size = "in shape, type or NaN" if np.isnan(largest) else f"by at most {largest:.2g}"
        lines.append(f"  {name}: {size} ({seeds_in_words(seeds)})")
    return in_lines(lines)
