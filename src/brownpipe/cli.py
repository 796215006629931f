"""The command line: one function per verb. Imports that take time are in the verbs that need them.

Only this module and `progress` write to the screen, with two exceptions: `parser` shows help, version and mistakes in
options, and `scene.reading.current_name` says on stderr that a name has been replaced by a newer one.
"""

import os
import signal
import sys
import time
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from brownpipe.errors import FAILED, BrownpipeError
from brownpipe.parser import build_parser

if TYPE_CHECKING:
    import numpy as np

    from brownpipe.engines import Engine
    from brownpipe.engines.state import Ensemble
    from brownpipe.scene import Scene

DONE = 0
RECORDS = ("tracer", "all", "events", "none")


def main(argv: list[str] | None = None) -> int:
    """Run one verb; return the exit status."""
    try:
        signal.signal(signal.SIGTERM, _terminate)
        sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # print any path in any encoding
        argv = sys.argv[1:] if argv is None else argv
        arguments = build_parser(VERBS, argv).parse_args(argv)
        arguments.argv = argv
        status = arguments.verb(arguments)
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        return _say("interrupted", 128 + signal.SIGINT)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader is gone: print no more
        return FAILED
    except BrownpipeError as error:
        return _say(str(error), error.exit_status)
    except (OSError, MemoryError) as error:
        return _say(str(error), FAILED)


def _terminate(*_: object) -> NoReturn:
    sys.exit(_say("terminated", 128 + signal.SIGTERM))


def _say(message: str, status: int) -> int:
    """Print a message on stderr, in one line; return the exit status."""
    print("brownpipe:", " ".join(message.split()) or "out of memory", file=sys.stderr)
    return status


# -- verbs ----------------------------------------------------------------------------------------------------------


def simulate(arguments: Namespace) -> int:
    """Run a scene once for every seed and write the trajectories.

    The tracer is always recorded, except with `--record none`. Runs that fail their health check are named, marked in
    the file and left out of every average; if all of them fail, the exit status is 1.
    `--observables` measures quantities at the end of each run, while the tracks of all disks are in memory, so that
    only the results need to be written.
    `--checkpoint-every` stores the state of the batch in FILE.h5.checkpoint: after this many seconds, when the next
    block of simulated time (some 128 collisions of each disk) is complete. If the command is killed, the same command
    resumes there and writes the same file, byte for byte.
    """
    from brownpipe.engines import forecast
    from brownpipe.scene import read_scene
    from brownpipe.scene.seeds import parse_seeds
    from brownpipe.study import refuse_repetition

    began = time.process_time()
    engine = _engine(arguments)
    record = _record(arguments.record)
    seeds = parse_seeds(arguments.seeds)
    scene = read_scene(arguments.scene, arguments.particles)
    refuse_repetition([scene], seeds)
    measures = _measures(arguments, scene)
    engine.refuse_unfit(scene, record)
    forecast.refuse_too_large(scene, len(seeds), record, **measures)
    output = _writable(arguments.output or f"{scene.name}.h5", arguments.scene)

    from brownpipe import progress
    from brownpipe.scene.seeds import seed_text
    from brownpipe.storage import remove_checkpoint, write_trajectories

    if remark := engine.definition.caution(scene):
        _say(remark, DONE)
    checkpoint = f"{output}.checkpoint"
    checkpointing = _checkpoints(arguments, checkpoint, scene, seeds, record)
    with progress.shown(lambda text: _say(text, DONE)):
        ensemble = engine.simulate(scene, seeds, record, *checkpointing, **measures)
    write_trajectories(output, scene, engine, ensemble)
    if arguments.checkpoint_every is not None:
        remove_checkpoint(checkpoint)
    failed = ensemble.seeds[ensemble.observables["failed"] > 0]
    if len(failed):
        _say(f"{output}: failed their health check: {len(failed)} of {len(seeds)} runs: {seed_text(failed)}", FAILED)
    print(_made(output, ensemble, time.process_time() - began))
    return FAILED if len(failed) == len(seeds) else DONE


def aggregate(arguments: Namespace) -> int:
    """Analyse trajectory files: one dataset of displacements, fits and distributions, with their errors over runs."""
    from brownpipe import analysis
    from brownpipe.storage import write_dataset

    output = _writable(arguments.output, *arguments.files)
    settings = (arguments.fit_windows, arguments.ring_width, arguments.rings, arguments.displacement_times)
    write_dataset(output, analysis.aggregate(arguments.files, *settings))
    return DONE


def figures(arguments: Namespace) -> int:
    """Draw the figures of a dataset, each with a table of its numbers, and write the summary."""
    from brownpipe.errors import FigureError
    from brownpipe.figures import tradeoff
    from brownpipe.figures.render import render
    from brownpipe.figures.summary import summary
    from brownpipe.storage import read_dataset, write_file
    from brownpipe.tradeoff import is_tradeoff

    dataset = read_dataset(arguments.dataset)
    if is_tradeoff(dataset):
        if arguments.figures or arguments.particles is not None:
            raise FigureError(f"{arguments.dataset}: a trade-off; it is shown as a whole")
        tradeoff.render(dataset, arguments.output)
        return DONE
    render(dataset, arguments.output, arguments.figures, arguments.particles)
    write_file(Path(arguments.output) / "summary.txt", summary(dataset).encode())
    return DONE


def movie(arguments: Namespace) -> int:
    """Show one whole run of a trajectory file: a picture, an animation (GIF), or a video (MP4, by ffmpeg).

    The file must have been recorded with `--record all`. The picture shows the end of the run.
    """
    from brownpipe.figures.movie import movie as moving
    from brownpipe.figures.movie import samples_shown
    from brownpipe.formatting import in_bytes
    from brownpipe.storage import read_trajectories, write_file

    output = _writable(arguments.output or f"{Path(arguments.file).stem}.gif", arguments.file)
    trajectories, kind = read_trajectories(arguments.file), Path(output).suffix
    contents = moving(trajectories, arguments.file, kind, arguments.seed, arguments.frames, arguments.fps)
    write_file(output, contents)
    frames = len(samples_shown(len(trajectories.ensemble.times), arguments.frames)) if kind != ".png" else 1
    print(f"{output}: {_number(frames, 'frame')}, {in_bytes(len(contents))}")
    return DONE


def tradeoff(arguments: Namespace) -> int:
    """Measure the cost-accuracy trade-off: bias and CPU time of every engine of a study, relative to its exact runs.

    Compares the trajectory files of the study, or those given by --files, and runs each engine for some seconds to
    measure its cost. `brownpipe figures` draws the figures and tables of the dataset.
    """
    from brownpipe import tradeoff as comparison
    from brownpipe.storage import write_dataset
    from brownpipe.study import read_study

    study = read_study(arguments.study)
    results = f"results/{study.name}"
    files = arguments.files or [f"{results}/simulate/{job.file}" for job in study.jobs()]
    output = _writable(arguments.output or f"{results}/tradeoff/{study.name}.nc", arguments.study, *files)
    write_dataset(output, comparison.measure(files, dict(study.instead_of), arguments.fit_window))
    return DONE


def plan(arguments: Namespace) -> int:
    """Find the engine and number of runs that meet a tolerance at the lowest cost, or the best accuracy for a CPU time.

    Uses stored results of `brownpipe tradeoff` that have the same scenes, otherwise pilot runs of some seconds.
    """
    from brownpipe.errors import RequestError
    from brownpipe.study import performance, read_study, writing
    from brownpipe.study import plan as planning
    from brownpipe.study.offers import offers

    study, budget = read_study(arguments.study), arguments.budget
    tolerance, target = study.tolerance, _target(arguments) or study.target or "msd"
    if arguments.tolerance is not None:
        tolerance = planning.tolerance_of(arguments.tolerance)
    if tolerance is None and budget is None:
        raise RequestError("--tolerance: missing; must be given, or --budget")
    output = None if arguments.write is None else _writable(arguments.write, arguments.study)
    cases = performance.performance_of(study, target)
    print(planning.describe(cases, target, tolerance, budget))
    best = next(iter(offers(cases, tolerance, budget)), None)
    if output is not None and best is not None:
        mapping = writing.derived_study(arguments.study, output, best.engine, best.runs, best.batch)
        writing.write_yaml(output, mapping, f"brownpipe plan {' '.join(arguments.argv[1:])}")
    return FAILED if best is None else DONE


def inspect(arguments: Namespace) -> int:
    """Describe the contents of a trajectory file or dataset, and say whether it is intact."""
    from brownpipe.storage import report, verify

    problems = verify(arguments.file)
    for problem in problems:
        _say(problem, FAILED)
    if not problems:
        print(report(arguments.file))
    return FAILED if problems else DONE


def check(arguments: Namespace) -> int:
    """Say whether a scene or study is valid, what will be simulated, and what it will cost."""
    from brownpipe.study.check import describe

    print(describe(arguments.file, arguments.particles))
    return DONE


VERBS = (simulate, aggregate, figures, movie, tradeoff, plan, inspect, check)


# -- parts of the verbs ---------------------------------------------------------------------------------------------


def _made(output: str, ensemble: "Ensemble", seconds: float) -> str:
    """Return one line: the file, its runs, their worst overlap (round-off for the exact engine) and the CPU time."""
    from brownpipe.formatting import in_time

    overlap = ensemble.observables.get("worst_overlap")
    worst = "" if overlap is None or not overlap.size else f", worst overlap {overlap.max():.2g} contact distances"
    return f"{output}: {_number(len(ensemble.seeds), 'run')}{worst}, {in_time(seconds)} of CPU"


def _number(count: int, name: str) -> str:
    return f"{count:,} {name}{'' if count == 1 else 's'}"


def _engine(arguments: Namespace) -> "Engine":
    """Return the requested engine with its settings. Raises RequestError for checkpoints of an engine without them."""
    from brownpipe.engines import DEFINITIONS, requested
    from brownpipe.errors import RequestError

    settings = {key: getattr(arguments, key) for definition in DEFINITIONS.values() for key in definition.settings}
    engine = requested(arguments.engine, {key: value for key, value in settings.items() if value is not None})
    if arguments.checkpoint_every is not None and not engine.definition.keeps_checkpoints:
        keepers = " or ".join(definition.name for definition in DEFINITIONS.values() if definition.keeps_checkpoints)
        wrong = f"--checkpoint-every {arguments.checkpoint_every:g}: the {engine.name} engine keeps no checkpoints"
        raise RequestError(f"{wrong}; must go with {keepers}")
    return engine


def _checkpoints(
    arguments: Namespace, path: str, scene: "Scene", seeds: Sequence[int], record: frozenset[str]
) -> tuple:
    """Return (Checkpoints,) for `exact.simulate`, stored in the file `path` and resumed from it if it exists.

    Without --checkpoint-every return ().
    """
    if arguments.checkpoint_every is None:
        return ()
    from brownpipe.engines.exact.checkpoint import Checkpoints
    from brownpipe.provenance import made_with
    from brownpipe.scene.seeds import seed_text
    from brownpipe.storage import read_checkpoint, write_checkpoint

    options = {"particles": scene.particles, "seeds": seed_text(seeds), "record": ",".join(sorted(record))}
    options |= {"observables": arguments.observables or "none", "average": arguments.average}
    made_by = options | {"engine": arguments.engine, "scene": scene.digest} | made_with("simulate", "exact")
    last_written = time.monotonic()

    def due() -> bool:
        return time.monotonic() - last_written >= arguments.checkpoint_every

    def store(arrays: "dict[str, np.ndarray]") -> None:
        nonlocal last_written
        write_checkpoint(path, made_by, arrays)
        last_written = time.monotonic()

    return (Checkpoints(due, store, read_checkpoint(path, made_by)),)


def _target(arguments: Namespace) -> str | None:
    """Return the quantity of --target, or of --observable, its old name; None if neither is given."""
    from brownpipe.errors import RequestError
    from brownpipe.scene.reading import Entry
    from brownpipe.study.study_file import read_target

    options = {f"--{name}": getattr(arguments, name) for name in ("target", "observable")}
    options = {option: value for option, value in options.items() if value is not None}
    if len(options) > 1:
        raise RequestError("--observable: is the old name of --target; must be given once")
    if "--observable" in options:
        _say("--observable: now called --target", DONE)
    return next((read_target(Entry(value, "", (option,))) for option, value in options.items()), None)


def _measures(arguments: Namespace, scene: "Scene") -> dict[str, Any]:
    """Return the observables to measure in each run and what they average over, as keywords of `simulate`."""
    from brownpipe.errors import RequestError
    from brownpipe.observables import problem

    names = tuple(arguments.observables.split(",")) if arguments.observables else ()
    refusal = problem(scene, names, arguments.average)
    if refusal is not None:
        key, why = refusal
        raise RequestError(f"{arguments.scene}: --{key} {getattr(arguments, key)}: {why}")
    return {"observables": names, "average": arguments.average}


def _record(text: str) -> frozenset[str]:
    """Return what to record: the names in --record and, except with `none`, the tracer."""
    from brownpipe.errors import RequestError

    names = frozenset(text.split(","))
    if not names <= set(RECORDS) or ("none" in names and len(names) > 1):
        raise RequestError(f"--record {text}: must be one or several of {', '.join(RECORDS)}, with commas; none alone")
    return names if "none" in names else names | {"tracer"}


def _writable(path: str, *inputs: str) -> str:
    """Return the path of an output file, links resolved, and make its folder.

    Called before anything is computed. Raises OSError or RequestError if the file could not be written afterwards.
    """
    path = os.path.realpath(path) if os.path.islink(path) else path
    _refuse_to_replace(path, inputs)
    if Path(path).is_dir():
        raise IsADirectoryError(f"{path}: is a folder; choose the name of a file")
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OSError(f"{path}: its folder cannot be made: {error.strerror}; choose another place") from error
    if not os.access(Path(path).parent, os.W_OK):
        raise PermissionError(f"{path}: its folder cannot be written to; choose another place")
    return path


def _refuse_to_replace(path: str, inputs: tuple[str, ...]) -> None:
    """Raise RequestError if the output would replace an input or something that is no ordinary file."""
    from brownpipe.errors import RequestError

    if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
        raise RequestError(f"{path}: is not an ordinary file; choose another name for the output")
    for file in inputs:
        if os.path.exists(path) and os.path.exists(file) and os.path.samefile(path, file):
            raise RequestError(f"{path}: is an input; choose another name for the output")
