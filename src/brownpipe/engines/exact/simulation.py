"""Runs of the exact engine, which can be interrupted and continued (`checkpoint`).

Each run is drawn from its seed (`initial_state`), equilibrated (`equilibration`), run from collision to collision
(`run`) and measured (`ensemble`).
"""

from collections.abc import Collection, Sequence

from brownpipe.engines.ensemble import Ensemble, RunResult, make_runs, new_batch
from brownpipe.engines.exact.checkpoint import NO_CHECKPOINTS, Checkpoints, pack, resume, saving_of
from brownpipe.engines.exact.equilibration import equilibrate, prepare_equilibration
from brownpipe.engines.exact.run import beginning, prepare_scene, recorder_of, to_end
from brownpipe.engines.initial_state import draw
from brownpipe.scene import Scene


def simulate(
    scene: Scene,
    seeds: Sequence[int],
    record: Collection[str] = frozenset({"tracer"}),
    checkpoints: Checkpoints = NO_CHECKPOINTS,
    *,
    observables: Collection[str] = (),
    average: str = "runs",
) -> Ensemble:
    """Run the scene once for every seed.

    `record` is a set of words: "tracer" (disk 0 of all runs), "all" (every disk of every run), "events" (every
    collision). `observables` are measured in each run, even if its trajectory is not recorded; `average` says over
    what displacements and autocorrelations among them are averaged (brownpipe.observables).
    `checkpoints` says when the state of the batch is stored, and which stored state to continue from; the result is
    bit-identical to that of an uninterrupted batch.
    A run that makes no progress, whose equilibration fails or whose disks find no place at random is failed, with
    the reason in `stopped`. Raises RequestError if the scene leaves no place for its disks in any run, or has no such
    observables.
    """
    batch = new_batch(scene, seeds, record, observables, average)
    equilibrator, prepared = prepare_equilibration(scene), prepare_scene(scene)
    recorder = recorder_of(prepared, scene.times, batch.needed_record)
    finished, unfinished = resume(checkpoints.stored, batch)

    def run(column: int) -> RunResult:
        saving = saving_of(checkpoints, batch.ensemble, column)
        start = unfinished if column == finished else None
        if start is None or start.equilibrating:
            drawn = draw(scene, int(batch.ensemble.seeds[column]))
            start = beginning(prepared, equilibrate(equilibrator, drawn, start, saving))
        return to_end(prepared, start, recorder, saving)

    def store(done: int) -> None:
        if done < len(batch.ensemble.seeds) and checkpoints.due():
            checkpoints.store(pack(batch.ensemble, done, None))

    return make_runs(batch, run, finished, store)
