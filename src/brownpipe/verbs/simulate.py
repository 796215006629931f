"""`brownpipe simulate`: runs of a scene, written to a trajectory file."""

import math
import time
from argparse import Namespace
from typing import get_type_hints

import numpy as np

from brownpipe import progress
from brownpipe.engines import (
    DEFINITIONS,
    Engine,
    engine_of_request,
    option,
    read_record,
    settings_section,
)
from brownpipe.engines.definition import REFERENCE_NAME, BatchCheckpoints, Checkpoints
from brownpipe.engines.ensemble import Ensemble, failures
from brownpipe.errors import DONE, FAILED, RequestError
from brownpipe.observables import OBSERVABLES
from brownpipe.observables.average import average_named
from brownpipe.observables.own import identity
from brownpipe.provenance import made_with
from brownpipe.scene.reading import Count, Positive, validated
from brownpipe.scene.seeds import MOST_SEEDS, Seeds, seed_text
from brownpipe.scene.variation import scene_with
from brownpipe.storage.configurations import read_scene_file
from brownpipe.storage.files import read_checkpoint, remove_checkpoint, write_checkpoint
from brownpipe.storage.trajectories import write_trajectories
from brownpipe.study.request import Request
from brownpipe.text import counted, in_time
from brownpipe.verbs import AddOption, Verb
from brownpipe.verbs.options import add_particles, key_value, several, typed
from brownpipe.verbs.output import HDF5, absent, writable
from brownpipe.verbs.screen import say, show


def _simulate_options(add: AddOption) -> None:
    add("scene", metavar="SCENE", help="scene file (YAML)")
    add_particles(add)
    replaced = (
        "another value of a key of the scene, like disks.tracer.mass=10 or packing_fraction=0.3; "
        "may be repeated"
    )
    add(
        "--value",
        dest="values",
        action="append",
        type=key_value,
        default=[],
        metavar="KEY=VALUE",
        help=replaced,
    )
    add(
        "--seeds",
        default="0",
        help="which seeds: 0-399 (400 runs), 17 (one run) or 3,5,9 (default: 0)",
    )
    summaries = [f"{definition.name}: {definition.summary}" for definition in DEFINITIONS.values()]
    engines = f"{'; '.join(summaries)} (default: {REFERENCE_NAME})"
    add("--engine", default=REFERENCE_NAME, metavar="NAME", help=engines)
    for definition in DEFINITIONS.values():
        fields = settings_section(definition.name).model_fields
        for key, kind in get_type_hints(definition.settings, include_extras=True).items():
            meaning = f"of {definition.name}: {fields[key].description}"
            add(option(key), type=typed(kind), help=meaning)
    what = (
        "tracer (default: its positions), velocity (of the tracer, too), all, events, none; "
        "all,events"
    )
    add("--record", default="tracer", metavar="WHAT", help=what)
    some = f"some of {', '.join(OBSERVABLES)}, or a function of your own, my_module:my_function"
    measured = f"what to measure in each run: names joined by commas, {some}"
    add("--observables", type=several(str), default=[], metavar="NAMES", help=measured)
    over = "runs (default), or in each run time origins, equal disks, or both: origins,disks"
    add("--average", default="runs", metavar="OVER", help=over)
    add(
        "--output",
        metavar="FILE.h5",
        help="trajectory file (default: name of the scene, in this folder)",
    )
    accepted = "exit status 1 if more than N runs fail, or `all`: never (default: all but one)"
    count = typed(Count)
    add(
        "--allow-failed",
        type=lambda text: math.inf if text == "all" else count(text),
        metavar="N",
        help=accepted,
    )
    add("--planned", metavar="SHA256", help="refuse runs other than those a study was planned with")
    add(
        "--checkpoint-every",
        type=typed(Positive),
        metavar="SECONDS",
        help="store checkpoints, to resume a killed run",
    )


def simulate_to_file(arguments: Namespace) -> int:
    """Run a scene once for every seed and write the trajectories.

    The tracer is always recorded, except with `--record none`. Runs that fail their health check or
    cannot go on are named, marked in the file with the reason and left out of every average. The
    exit status is 1 if all of them fail, or with `--allow-failed N` if more than N do. A scene in
    which nearly every run finds no places is refused. `--observables` measures quantities at the
    end of each run, while the tracks of all disks are in memory, so that only the results need to
    be written.
    `--checkpoint-every` stores the state of the batch in FILE.h5.checkpoint: after this many
    seconds, when the next block of simulated time (some 128 collisions of each disk) is complete.
    If the command is killed, the same command resumes there and writes the same file, byte for
    byte.

    example: brownpipe simulate config/scenes/harrison2020.yaml --seeds 17 --record all --output
    seed17.h5
    """
    began = time.process_time()
    request = _request_of(arguments)
    scene = request.scene
    seeds = request.seeds
    cost = request.forecast()
    if arguments.planned not in (None, request.digest):
        raise RequestError(
            f"{arguments.scene}: has changed since the study was planned; run the study again"
        )
    output = arguments.output or absent(f"{scene.name}.h5")
    size = len(seeds) * cost.bytes_in_file
    output = writable(output, arguments.scene, suffixes=HDF5, size=size)

    for caution in request.engine.cautions(scene, request.observables):
        say(caution, DONE)
    checkpoint = f"{output}.checkpoint"
    checkpoints = _checkpoints(arguments, checkpoint, request)
    with progress.shown("simulate"):
        ensemble = request.make(seeds, checkpoints)
    write_trajectories(output, scene, request.engine, ensemble, digest=arguments.planned or "")
    if arguments.checkpoint_every is not None:
        remove_checkpoint(checkpoint)
    failed = failures(ensemble)
    if failed:
        say(f"{output}: {failed}", FAILED)
    summary = _summary(output, ensemble, time.process_time() - began)
    show(f"{summary}{_other_seeds(arguments.seeds)}")
    allowed = len(seeds) - 1 if arguments.allow_failed is None else arguments.allow_failed
    return FAILED if len(ensemble.failed_seeds) > allowed else DONE


def _request_of(arguments: Namespace) -> Request:
    """Return the runs that are asked for; refuse words that say none."""
    engine = engine_of(arguments)
    record = read_record(arguments.record, "--record")
    seeds = validated(Seeds, arguments.seeds, key="seeds")
    mapping = read_scene_file(arguments.scene)
    scene = scene_with(mapping, arguments.scene, dict(arguments.values), arguments.particles)
    names = tuple(arguments.observables)
    average = average_named(arguments.average)
    return Request(scene, seeds, engine, record, observables=names, average=average)


def _summary(output: str, ensemble: Ensemble, seconds: float) -> str:
    """Return one line: the file, its runs, their worst overlap (round-off for the exact engine) and
    the CPU time.
    """
    overlaps = zip(ensemble.seeds, ensemble.observables.get("worst_overlap", ()), strict=False)
    sound = [overlap for seed, overlap in overlaps if seed not in ensemble.stopped]
    worst = f", worst overlap {max(sound):.2g} contact distances" if sound else ""
    runs = counted(len(ensemble.seeds), "run")
    which = f"seed {ensemble.seeds[0]}, {runs}" if len(ensemble.seeds) == 1 else runs
    return f"{output}: {which}{worst}, {in_time(seconds)} of CPU"


def _other_seeds(asked: str) -> str:
    """Return how to ask for that many runs, if one number was given: it is a seed, not a count.

    `--seeds 10` gives "; 10 runs: --seeds 0-9".
    """
    if not asked.strip().isdecimal() or not 1 < int(asked) <= MOST_SEEDS:
        return ""
    return f"; {counted(int(asked), 'run')}: --seeds 0-{int(asked) - 1}"


def engine_of(arguments: Namespace) -> Engine:
    """Return the requested engine with its settings. Raises RequestError for checkpoints of an
    engine without them.
    """
    settings = {}
    for definition in DEFINITIONS.values():
        for key in definition.settings._fields:
            value = getattr(arguments, key)
            if value is not None:
                settings[key] = value
    engine = engine_of_request(arguments.engine, settings)
    if arguments.checkpoint_every is not None and not engine.definition.keeps_checkpoints:
        keepers = [
            definition.name for definition in DEFINITIONS.values() if definition.keeps_checkpoints
        ]
        raise RequestError(
            f"--checkpoint-every: must go with {' or '.join(keepers)}; {engine.name} keeps no "
            "checkpoints"
        )
    return engine


def _checkpoints(arguments: Namespace, path: str, request: Request) -> BatchCheckpoints | None:
    """Return checkpoints of the runs, which are stored in the file `path` and resumed from it if it
    exists.

    Without --checkpoint-every return None.
    """
    if arguments.checkpoint_every is None:
        return None
    names = ",".join(map(identity, request.observables))
    made_by = {
        "particles": request.scene.particles,
        "seeds": seed_text(request.seeds),
        "record": ",".join(sorted(request.record)),
        "observables": names or "none",
        "average": request.average,
        "engine": request.engine.name,
        "scene": request.scene.digest,
    }
    for name, value in made_with("simulate", REFERENCE_NAME).items():
        made_by[name.partition("_")[0]] = value
    last_written = time.monotonic()

    def due() -> bool:
        return time.monotonic() - last_written >= arguments.checkpoint_every

    def store(arrays: dict[str, np.ndarray]) -> None:
        nonlocal last_written
        write_checkpoint(path, made_by, arrays)
        last_written = time.monotonic()

    return Checkpoints(due, store, read_checkpoint(path, made_by))


SIMULATE = Verb("simulate", simulate_to_file, _simulate_options)
