"""Runs of the exact engine, which can be interrupted and continued (`checkpoint`).

Each run is drawn from its seed (`initial_state`), equilibrated (`equilibration`), run from collision to collision
(`run`) and measured (`batch`).
"""

from collections.abc import Collection, Sequence

from brownpipe.engines.batch import Batch, add_run, making_run, new_batch
from brownpipe.engines.compiled import KernelCall
from brownpipe.engines.exact import equilibration, run
from brownpipe.engines.exact.checkpoint import NO_CHECKPOINTS, Checkpoints, pack, resume, saving_of
from brownpipe.engines.exact.equilibration import equilibrate, prepare_equilibration
from brownpipe.engines.exact.run import EndedRun, PreparedScene, beginning, prepare_scene, results_of, to_end
from brownpipe.engines.initial_state import draw
from brownpipe.engines.state import Ensemble
from brownpipe.scene import Scene

MOST_TOGETHER = 32  # runs that are reported at once
ROWS_TOGETHER = 8192  # disks and samples of these runs, which are kept in memory until then


def kernel_calls(scene: Scene) -> list[KernelCall]:
    """Return the calls that compile the kernels for a scene."""
    return run.kernel_calls(scene) + equilibration.kernel_calls(scene)


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
    observables, StorageError if the stored state is not one of such a batch.
    """
    batch = new_batch(scene, seeds, record, observables, average)
    equilibrator = prepare_equilibration(scene)
    prepared = prepare_scene(scene)
    ensemble, runs = batch.ensemble, len(batch.ensemble.seeds)
    finished, stored = resume(checkpoints.stored, batch)
    together = 1 if checkpoints is not NO_CHECKPOINTS else _reported_together(batch)
    ended: dict[int, EndedRun] = {}  # by column
    for column in range(finished, runs):
        saving = saving_of(checkpoints, ensemble, column)
        with making_run(batch, column):
            start = stored
            if start is None or start.equilibrating:
                drawn = draw(scene, int(ensemble.seeds[column]))
                start = beginning(prepared, equilibrate(equilibrator, drawn, stored, saving))
            ended[column] = to_end(prepared, start, scene.times, batch.needed_record, saving)
            if together > 1:
                ended[column] = ended[column].kept()
        stored = None
        if len(ended) >= together or not ensemble.observables:  # files keep the order of the first report
            _report(prepared, ended, batch)
        if column + 1 < runs and checkpoints.due():
            checkpoints.store(pack(ensemble, column + 1, None))
    _report(prepared, ended, batch)
    return ensemble


def _report(prepared: PreparedScene, ended: dict[int, EndedRun], batch: Batch) -> None:
    """Move runs that have ended, by column, to the batch, with their reports."""
    if ended:
        for column, result in zip(ended, results_of(prepared, list(ended.values())), strict=True):
            add_run(batch, column, result)
        ended.clear()


def _reported_together(batch: Batch) -> int:
    """Return how many runs are reported at once: several of few disks, whose reports take as long as the runs."""
    if not batch.needed_record <= {"tracer"}:
        return 1
    return max(1, min(MOST_TOGETHER, ROWS_TOGETHER // (batch.scene.particles + len(batch.scene.times))))
