"""Runs of the exact engine, which can be interrupted and continued.

Each run is drawn from its seed (`initial_state`), equilibrated, run from collision to collision
(`run`) and measured (`ensemble`).
"""

import json
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from brownpipe.engines.definition import BatchCheckpoints
from brownpipe.engines.ensemble import Batch, Ensemble, make_runs, new_batch, select, write_columns
from brownpipe.engines.exact.run import (
    NO_CHECKPOINTS,
    Checkpoints,
    PreparedScene,
    RunState,
    prepare_scene,
    run_to_end,
    state_at_start,
)
from brownpipe.engines.start.initial_state import draw_state, with_zero_momentum
from brownpipe.engines.units import State
from brownpipe.errors import RunError
from brownpipe.observables.own import own_arrays
from brownpipe.observables.trajectory import Events, Run, Track
from brownpipe.scene import Scene, motion


def simulate(
    scene: Scene,
    seeds: Sequence[int],
    record: Collection[str] = frozenset({"tracer"}),
    checkpoints: BatchCheckpoints = NO_CHECKPOINTS,
    *,
    observables: Collection[str] = (),
    average: str = "runs",
) -> Ensemble:
    """Run the scene once for every seed.

    `record` is a set of words: "tracer" (disk 0 of all runs), "all" (every disk of every run),
    "events" (every collision). `observables` are measured in each run, even if its trajectory is
    not recorded; `average` says over what displacements and autocorrelations among them are
    averaged (brownpipe.observables).
    `checkpoints` says when the state of the batch is stored, and which stored state to continue
    from; the result is bit-identical to that of an uninterrupted batch.
    A run that makes no progress, whose equilibration fails or whose disks find no place at random
    is marked as failed, with the reason in `stopped`. Raises RequestError if the scene leaves no
    place for its disks in any run, or has no such observables.
    """
    batch = new_batch(scene, seeds, record, observables, average)
    equilibrator = prepare_equilibration(scene)
    prepared = prepare_scene(scene, scene.times, batch.needed_record)
    finished, unfinished = resume(checkpoints.stored, batch)

    def run(column: int) -> Run:
        def store_run(state: RunState) -> None:
            checkpoints.store(pack(batch.ensemble, column, state))

        saving = Checkpoints(checkpoints.due, store_run)
        start = unfinished if column == finished else None
        if start is None or start.equilibrating:
            drawn = draw_state(scene, int(batch.ensemble.seeds[column]))
            start = state_at_start(prepared, equilibrate(equilibrator, drawn, start, saving))
        return run_to_end(prepared, start, saving)

    def store_batch(done: int) -> None:
        if done < len(batch.ensemble.seeds) and checkpoints.due():
            checkpoints.store(pack(batch.ensemble, done, None))

    return make_runs(batch, run, finished, store_batch)


# -- the state at t = 0, from which all engines that move all disks start --------------------------


def prepare_equilibration(scene: Scene) -> PreparedScene | None:
    """Return what equilibrates the states of a scene; None if it has no time to equilibrate."""
    time = scene.equilibrate.time
    if not time > 0:
        return None
    pinned = scene.equilibrate.tracer == "pinned"
    return prepare_scene(scene, np.array([time]), {"all"}, pinned)


def equilibrate(
    prepared: PreparedScene | None,
    state: State,
    stored: RunState | None = None,
    saving: Checkpoints[RunState] = NO_CHECKPOINTS,
) -> State:
    """Run a drawn state for the scene's time to equilibrate, or continue a stored run; return the
    state at t = 0.

    `prepared` is from `prepare_equilibration`; if it is None, the drawn state is returned. A pinned
    tracer keeps its place and regains its velocity at t = 0. Raises RunError if the run fails its
    health check or makes no progress.
    """
    if prepared is None:
        return state
    scene = prepared.scene
    moving = np.arange(len(state.mass)) >= int(prepared.pinned)  # all disks, or all but the tracer
    at_rest_if_pinned = state._replace(velocity=state.velocity * moving[:, None])
    start = stored or state_at_start(prepared, at_rest_if_pinned, equilibrating=True)
    result = run_to_end(prepared, start, saving)
    if result.observables["failed"]:
        raise RunError("the time to equilibrate failed its health check")
    end = state_at_end(state, result.every_disk)
    if prepared.pinned:
        end.position[0] = state.position[0]
        end.velocity[0] = state.velocity[0]
    if motion.starts_with_zero_momentum(scene):
        return end._replace(velocity=with_zero_momentum(scene, end.velocity))
    return end


def state_at_end(state: State, track: Track) -> State:
    """Return the state at the last sample of the tracks of the same disks."""
    return state._replace(position=track.position[-1], velocity=track.known_velocity[-1])


# -- checkpoints -----------------------------------------------------------------------------------
# The finished runs, and the unfinished one at the end of a block, as named arrays.


def pack(ensemble: Ensemble, finished: int, state: RunState | None) -> dict[str, np.ndarray]:
    """Return named arrays of the first `finished` runs and the state of the next one; they are
    views, not copies.

    A name is the path of an array in the record of the ensemble or the state:
    `runs.tracer.position`, `runs.whole.SEED.velocity`, `run.motion`. Texts are stored as bytes,
    descriptions of a user's own arrays as JSON.
    """
    runs = select(ensemble, slice(finished))._asdict()
    runs["own"] = json.dumps(ensemble.own)
    return _flat("runs", runs) | _flat("run", state)


def resume(arrays: dict[str, np.ndarray] | None, batch: Batch) -> tuple[int, RunState | None]:
    """Copy the finished runs of a checkpoint into a batch; return their number, and the unfinished
    run, if any.
    """
    if arrays is None:
        return 0, None
    groups = _nested(arrays)
    runs = groups["runs"]
    ensemble = batch.ensemble
    finished = len(runs["seeds"])
    tracer = Track(**runs["tracer"]) if "tracer" in runs else None
    write_columns(ensemble, slice(finished), tracer, runs.get("observables", {}))
    for seed in ensemble.seeds[:finished].tolist():  # a file lists names as texts, 10 before 8
        for name, kind in (("whole", Track), ("events", Events)):
            if str(seed) in runs.get(name, {}):
                getattr(ensemble, name)[seed] = kind(**runs[name][str(seed)])
    for seed, reason in runs.get("stopped", {}).items():
        ensemble.stopped[int(seed)] = reason.item().decode()
    ensemble.own.update(own_arrays({"own_arrays": runs["own"].item()}))
    if "run" not in groups:
        return finished, None
    state = groups["run"]
    if "events" in state:
        state["events"] = Events(**state["events"])
    return finished, RunState(**state)


def _nested(arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return named arrays in nested dictionaries, one for each word of their names.

    >>> _nested({"run.slots": 8, "runs.whole.7.position": 0.5})
    {'run': {'slots': 8}, 'runs': {'whole': {'7': {'position': 0.5}}}}
    """
    groups: dict[str, Any] = {}
    for name, values in arrays.items():
        *path, last = name.split(".")
        group = groups
        for word in path:
            group = group.setdefault(word, {})
        group[last] = values
    return groups


def _flat(name: str, value: object) -> dict[str, np.ndarray]:
    """Return all arrays in a record or a mapping by the paths to them, which begin with `name`;
    without None.
    """
    if value is None:
        return {}
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, str):
        value = value.encode()
    if not isinstance(value, dict):
        return {name: np.asarray(value)}
    arrays: dict[str, np.ndarray] = {}
    for key, entry in value.items():
        arrays |= _flat(f"{name}.{key}", entry)
    return arrays
