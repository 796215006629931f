"""Runs of the exact engine, which can be interrupted and continued (`checkpoint`).

Each run is drawn from its seed (`initial_state`), equilibrated (`equilibration`), run from collision to collision
(`run`) and measured (`batch`).
"""

from collections import deque
from collections.abc import Collection, Iterator, Sequence
from functools import partial

from brownpipe.engines.batch import making_run, most_together, new_batch, report_ended
from brownpipe.engines.exact.checkpoint import NO_CHECKPOINTS, Checkpoints, pack, resume, saving_of
from brownpipe.engines.exact.equilibration import equilibrate, prepare_equilibration
from brownpipe.engines.exact.run import (
    beginning,
    prepare_scene,
    recorder_of,
    results_of,
    to_end,
)
from brownpipe.engines.initial_state import draw
from brownpipe.engines.recording import EndedRun, kept
from brownpipe.engines.state import Ensemble, State
from brownpipe.errors import RequestError
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
    equilibrator = prepare_equilibration(scene)
    prepared = prepare_scene(scene)
    ensemble, runs = batch.ensemble, len(batch.ensemble.seeds)
    finished, stored = resume(checkpoints.stored, batch)
    together = 1 if checkpoints is not NO_CHECKPOINTS else most_together(batch, scene.particles + len(scene.times))
    results = partial(results_of, prepared)
    drawn: deque[State | RequestError] = deque()  # of the next runs
    ended: dict[int, EndedRun] = {}  # by column
    recorder = None
    for column in range(finished, runs):
        saving = saving_of(checkpoints, ensemble, column)
        with making_run(batch, column):
            if stored is not None and not stored.equilibrating:
                start = stored
            else:
                drawn = drawn or deque(_drawn(scene, ensemble.seeds[column : column + together].tolist()))
                start = beginning(prepared, equilibrate(equilibrator, _next(drawn), stored, saving))
            recorder = recorder or recorder_of(prepared, scene.times, batch.needed_record)
            ended[column] = to_end(prepared, start, recorder, saving)
            if together > 1:
                ended[column] = kept(ended[column])
        stored = None
        report_ended(batch, ended, results, together)
        if column + 1 < runs and checkpoints.due():
            checkpoints.store(pack(ensemble, column + 1, None))
    report_ended(batch, ended, results)
    return ensemble


def _drawn(scene: Scene, seeds: Sequence[int]) -> Iterator[State | RequestError]:
    """Yield the state drawn from each seed, up to the first that cannot be: its error, to be raised at its turn."""
    try:
        for seed in seeds:
            yield draw(scene, seed)
    except RequestError as error:
        yield error


def _next(drawn: deque[State | RequestError]) -> State:
    """Return the next state; raise its error if it could not be drawn."""
    state = drawn.popleft()
    if isinstance(state, RequestError):
        raise state
    return state
