"""The command line: one verb per step. The only place that prints.

Every import that costs time stands in the verb that needs it.
"""

import argparse
import os
import signal
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from brownpipe.errors import FAILED, WRONG_REQUEST, BrownpipeError

DONE = 0
RECORDS = ("tracer", "all", "events", "none")
FIGURES = ("msd", "displacement_distribution", "diffusion", "velocity_autocorrelation", "velocity_distribution")
FIGURES += ("pair_distribution", "energy", "thermodynamics", "particle_counts", "health")


def main(argv: list[str] | None = None) -> int:
    """Run one verb; return the exit status."""
    try:
        signal.signal(signal.SIGTERM, _terminate)
        sys.stdout.reconfigure(errors="backslashreplace")  # any path can be said, in any language
        arguments = _parser().parse_args(argv)
        arguments.words = sys.argv[1:] if argv is None else argv
        status = arguments.verb(arguments)
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        return _say("interrupted", 128 + signal.SIGINT)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nobody reads on: say no more
        return FAILED
    except BrownpipeError as error:
        return _say(str(error), error.exit_status)
    except (OSError, MemoryError) as error:
        return _say(str(error), FAILED)


def _terminate(*_) -> NoReturn:
    sys.exit(_say("terminated", 128 + signal.SIGTERM))


def _say(message: str, status: int) -> int:
    print("brownpipe:", " ".join(message.split()) or "out of memory", file=sys.stderr)
    return status


# -- verbs ----------------------------------------------------------------------------------------------------------


def simulate(arguments) -> int:
    """Run a scene once for every seed and write the trajectories.

    The tracer is recorded in any case, except with `--record none`. Runs that fail their health check are marked in
    the file, named, and never averaged in; if none is left, the exit status is 1.
    With `--observables`, what needs all disks is measured in each run, and only the result is kept:
    square_displacement, velocity_autocorrelation, species_energy, velocity_distribution, pair_distribution.
    With `--checkpoint-every`, what is done so far is kept in FILE.h5.checkpoint, at the first end of a block of time
    (some 128 collisions of each disk) after so many seconds. The same command goes on from there if it was killed, to
    the same file, byte for byte.
    """
    from brownpipe.engines import forecast
    from brownpipe.scene import read_scene
    from brownpipe.scene.seeds import parse_seeds
    from brownpipe.study import refuse_repetition

    began = time.process_time()
    engine, record, seeds = _engine(arguments), _record(arguments.record), parse_seeds(arguments.seeds)
    scene = read_scene(arguments.scene, arguments.particles)
    refuse_repetition([scene], seeds)
    measures = _measures(arguments, scene)
    engine.refuse_unfit(scene, record)
    forecast.refuse_too_large(scene, len(seeds), record, **measures)
    output = _writable(arguments.output or f"{scene.name}.h5", arguments.scene)

    from brownpipe.scene.seeds import seed_text
    from brownpipe.storage import remove_checkpoint, write_trajectories

    if remark := engine.definition.caution(scene):
        _say(remark, DONE)
    checkpoint = f"{output}.checkpoint"
    kept = _checkpoints(arguments, checkpoint, scene, seeds, record)
    with _told_about_runs():
        ensemble = engine.simulate(scene, seeds, record, *kept, **measures)
    write_trajectories(output, scene, engine, ensemble)
    if arguments.checkpoint_every is not None:
        remove_checkpoint(checkpoint)
    failed = ensemble.seeds[ensemble.observables["failed"] > 0]
    if len(failed):
        _say(f"{output}: failed their health check: {len(failed)} of {len(seeds)} runs: {seed_text(failed)}", FAILED)
    print(_made(output, ensemble, time.process_time() - began))
    return FAILED if len(failed) == len(seeds) else DONE


def aggregate(arguments) -> int:
    """Make one dataset of trajectory files: displacements, fits and counts with their errors over runs."""
    from brownpipe import analysis
    from brownpipe.storage import write_dataset

    output = _writable(arguments.output, *arguments.files)
    asked = (arguments.fit_windows, arguments.ring_width, arguments.rings, arguments.displacement_times)
    write_dataset(output, analysis.aggregate(arguments.files, *asked))
    return DONE


def figures(arguments) -> int:
    """Draw the figures of a dataset, each with its numbers, and write the summary."""
    from brownpipe import figures as drawing
    from brownpipe.storage import read_dataset, write_file

    dataset = read_dataset(arguments.dataset)
    if "seconds" in dataset:  # of `tradeoff`, not of `aggregate`
        if arguments.figures or arguments.particles is not None:
            raise drawing.FigureError(f"{arguments.dataset}: a trade-off; it is shown as a whole")
        drawing.tradeoff.render(dataset, arguments.output)
        return DONE
    drawing.render(dataset, arguments.output, arguments.figures, arguments.particles)
    write_file(Path(arguments.output) / "summary.txt", drawing.summary(dataset).encode())
    return DONE


def movie(arguments) -> int:
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


def tradeoff(arguments) -> int:
    """Measure what accuracy a CPU time buys: every engine of a study against its exact runs.

    Compares the study's trajectory files, or those of --files, and runs each engine for some seconds to learn its
    price. `brownpipe figures` makes figures and tables of the dataset.
    """
    from brownpipe import tradeoff as prices
    from brownpipe.storage import write_dataset
    from brownpipe.study import read_study

    study = read_study(arguments.study)
    results = f"results/{study.name}"
    files = arguments.files or [f"{results}/simulate/{job.file}" for job in study.jobs()]
    output = _writable(arguments.output or f"{results}/tradeoff/{study.name}.nc", arguments.study, *files)
    write_dataset(output, prices.measure(files, dict(study.instead_of), arguments.fit_window))
    return DONE


def plan(arguments) -> int:
    """Say which engine and how many runs meet a tolerance at the lowest cost, or what a CPU time buys.

    By stored results of `brownpipe tradeoff` that hold the same scenes, or else by a pilot of some seconds.
    """
    from brownpipe.errors import RequestError
    from brownpipe.study import plan as planning
    from brownpipe.study import read_study

    study, budget = read_study(arguments.study), arguments.budget
    tolerance, observable = study.tolerance, arguments.observable or study.observable or "msd"
    if arguments.tolerance is not None:
        tolerance = planning.tolerance_of(arguments.tolerance)
    if tolerance is None and budget is None:
        raise RequestError("--tolerance: missing; must be given, or --budget")
    output = None if arguments.write is None else _writable(arguments.write, arguments.study)
    cases = planning.cases_of(study, observable)
    print(planning.describe(cases, observable, tolerance, budget))
    found = planning.offers(cases, tolerance, budget)
    if output is not None and found:
        comment = f"brownpipe plan {' '.join(arguments.words[1:])}"
        planning.write_yaml(output, planning.study_of(arguments.study, found[0], output), comment)
    return DONE if found else FAILED


def inspect(arguments) -> int:
    """Say what is in a trajectory file or dataset, and whether it is intact."""
    from brownpipe.storage import report, verify

    problems = verify(arguments.file)
    for problem in problems:
        _say(problem, FAILED)
    if not problems:
        print(report(arguments.file))
    return FAILED if problems else DONE


def check(arguments) -> int:
    """Say whether a scene or a study is valid, what will be modelled, and what it will cost."""
    from brownpipe.study.check import describe

    print(describe(arguments.file, arguments.particles))
    return DONE


@contextmanager
def _told_about_runs():
    """Say meanwhile what is compiled and, on a terminal, how many runs are done and how long the others will take."""
    from brownpipe.engines import batch, kernels

    hooks = [(kernels.on_compile, lambda text: _say(text, DONE))]
    if sys.stderr.isatty():
        hooks.append((batch.on_entry, _counter()))
    for told, function in hooks:
        told.append(function)
    try:
        yield
    finally:
        for told, function in hooks:
            told.remove(function)
        if sys.stderr.isatty():
            _rewrite("")


def _counter():
    """Return a function that shows how far a batch is, in a line that is written over, a few times a second."""
    from brownpipe.formatting import in_time

    first = shown = began = None

    def tell(done: int, runs: int) -> None:
        nonlocal first, shown, began
        now = time.monotonic()
        if first is None:  # the clock starts here: compiling and preparing came before
            first, shown, began = done, -1.0, now
        if now - shown > 0.2:
            still = f", about {in_time((now - began) / (done - first) * (runs - done))} to go" if done > first else ""
            _rewrite(f"{done:,} of {runs:,} runs done{still}")
            shown = now

    return tell


def _rewrite(text: str) -> None:
    """Write text in place of what is in the last line of the terminal."""
    sys.stderr.write(f"\r\033[K{text}")
    sys.stderr.flush()


def _made(output: str, ensemble, seconds: float) -> str:
    """What was simulated, how well and at what cost, in one line. The exact engine's overlaps are round-off."""
    from brownpipe.formatting import in_time

    overlap = ensemble.observables.get("worst_overlap")
    worst = "" if overlap is None or not overlap.size else f", worst overlap {overlap.max():.2g} contact distances"
    return f"{output}: {_number(len(ensemble.seeds), 'run')}{worst}, {in_time(seconds)} of CPU"


def _number(count: int, name: str) -> str:
    return f"{count:,} {name}{'' if count == 1 else 's'}"


def _engine(arguments):
    """The engine asked for, with its settings. Only the exact one can go on where a run was killed."""
    from brownpipe.engines import DEFINITIONS, requested
    from brownpipe.errors import RequestError

    settings = {key: getattr(arguments, key) for one in DEFINITIONS.values() for key in one.settings}
    engine = requested(arguments.engine, {key: value for key, value in settings.items() if value is not None})
    if arguments.checkpoint_every is not None and not engine.definition.keeps_checkpoints:
        asked = f"--checkpoint-every {arguments.checkpoint_every:g}"
        raise RequestError(f"{asked}: the {engine.name} engine keeps no checkpoints; must go with exact")
    return engine


def _checkpoints(arguments, path: str, scene, seeds, record) -> tuple:
    """Return (Checkpoints,) for `exact.simulate`: written to a file, continued from it if it is there; () unasked."""
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

    def store(arrays) -> None:
        nonlocal last_written
        write_checkpoint(path, made_by, arrays)
        last_written = time.monotonic()

    return (Checkpoints(due, store, read_checkpoint(path, made_by)),)


def _measures(arguments, scene) -> dict:
    """What to measure in each run, and the averages to be made there."""
    from brownpipe.errors import RequestError
    from brownpipe.observables import problem

    names = tuple(arguments.observables.split(",")) if arguments.observables else ()
    found = problem(scene, names, arguments.average)
    if found is not None:
        key, why = found
        raise RequestError(f"{arguments.scene}: --{key} {getattr(arguments, key)}: {why}")
    return {"observables": names, "average": arguments.average}


def _record(text: str) -> frozenset[str]:
    """What to record: the words asked for and, except with `none`, the tracer."""
    from brownpipe.errors import RequestError

    words = frozenset(text.split(","))
    if not words <= set(RECORDS) or ("none" in words and len(words) > 1):
        raise RequestError(f"--record {text}: must be one or several of {', '.join(RECORDS)}, with commas; none alone")
    return words if "none" in words else words | {"tracer"}


def _writable(path: str, *inputs: str) -> str:
    """Return the path of a file to be written, after its folder is made: better now than when all is computed."""
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
    """What is written takes the place of what was there, which must be neither an input nor, say, a device."""
    from brownpipe.errors import RequestError

    if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
        raise RequestError(f"{path}: is not an ordinary file; choose another name for the output")
    for one in inputs:
        if os.path.exists(path) and os.path.exists(one) and os.path.samefile(path, one):
            raise RequestError(f"{path}: is an input; choose another name for the output")


# -- the words ------------------------------------------------------------------------------------------------------


class _Parser(argparse.ArgumentParser):
    """As argparse has it, but with messages of one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(WRONG_REQUEST, f"{self.prog}: {' '.join(message.split())} (see {self.prog} --help)\n")


class _Version(argparse.Action):
    """Looks the version up only when it is asked for."""

    def __call__(self, parser, *_) -> NoReturn:
        from importlib.metadata import version

        print("brownpipe", version("brownpipe"))
        parser.exit(DONE)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser("brownpipe", description="Hard disks that collide exactly, a heavy one among them that wanders.")
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    scene = "config/scenes/harrison2020.yaml"

    one = _verb(verbs, simulate, f"brownpipe simulate {scene} --seeds 17 --record all --output seed17.h5")
    one.add_argument("scene", metavar="SCENE", help="scene file (YAML)")
    one.add_argument("--particles", type=_integer, metavar="N", help="number of disks instead of the scene's")
    one.add_argument("--seeds", default="0", help="0-2399, 17 or 3,5,9 (default: 0)")
    one.add_argument(
        "--engine",
        default="exact",
        metavar="NAME",
        help="exact (default): event by event; timestep: in steps; langevin: the tracer alone, in friction and noise",
    )
    one.add_argument("--time-step", type=_positive, metavar="DT", help="of timestep: must be given")
    one.add_argument("--precision", metavar="WHICH", help="of timestep: double (default) or single")
    one.add_argument("--collisions", metavar="WHEN", help="of timestep: at_contact (default) or late")
    one.add_argument("--friction", metavar="WHICH", help="of langevin: enskog, boltzmann or measured")
    one.add_argument(
        "--record", default="tracer", metavar="WHAT", help="tracer (default), all, events, none; all,events"
    )
    one.add_argument(
        "--observables",
        type=_observables,
        metavar="NAMES",
        help="what to measure in each run, like square_displacement,species_energy",
    )
    one.add_argument(
        "--average", default="runs", metavar="OVER", help="runs (default), or all time origins or equal disks of a run"
    )
    one.add_argument("--output", metavar="FILE.h5", help="trajectory file (default: name of the scene, in this folder)")
    one.add_argument(
        "--checkpoint-every", type=_positive, metavar="SECONDS", help="keep what is done, to go on if killed"
    )

    one = _verb(verbs, aggregate, "brownpipe aggregate results/small/simulate/*/*/*/*.h5 --output small.nc")
    one.add_argument("files", nargs="+", metavar="FILE.h5", help="trajectory files of one study, in any order")
    one.add_argument("--output", required=True, metavar="DATASET.nc")
    windows = {"nargs": "+", "type": _window, "metavar": "T0:T1"}
    one.add_argument("--fit-windows", **windows, help="where lines are fitted to the MSD (default: 0.1:1 0.5:1)")
    one.add_argument(
        "--ring-width", type=_positive, metavar="DR", help="of the distribution, with --rings (default: from the data)"
    )
    times = {"nargs": "+", "type": _positive, "metavar": "T"}
    one.add_argument("--displacement-times", **times, help="of the distribution (default: the end of each run)")
    one.add_argument("--rings", type=_rings, metavar="COUNT", help="of the distribution, with --ring-width")

    one = _verb(verbs, figures, "brownpipe figures small.nc --output figures")
    one.add_argument("dataset", metavar="DATASET.nc")
    one.add_argument("--output", required=True, metavar="FOLDER")
    one.add_argument(
        "--figures", nargs="+", choices=FIGURES, metavar="NAME", help=f"some of {', '.join(FIGURES)} (default: all)"
    )
    one.add_argument(
        "--particles", type=_integer, metavar="N", help="show the runs with this many disks (default: 150)"
    )

    one = _verb(verbs, movie, "brownpipe movie seed17.h5 --output seed17.gif")
    one.add_argument("file", metavar="FILE.h5", help="trajectory file with whole runs (simulate --record all)")
    one.add_argument("--seed", type=_integer, metavar="SEED", help="the run to show (default: the first in the file)")
    one.add_argument("--output", metavar="FILE", help="*.gif, *.mp4 or *.png (default: name of the file, .gif)")
    one.add_argument("--frames", type=_frames, metavar="COUNT", help="samples to show (default: all)")
    one.add_argument("--fps", type=_positive, default=25.0, help="frames a second (default: 25)")
    one = _verb(verbs, tradeoff, "brownpipe tradeoff config/tradeoff.yaml")
    one.add_argument("study", metavar="STUDY", help="study file (YAML)")
    one.add_argument("--files", nargs="+", metavar="FILE.h5", help="trajectory files (default: those of the study)")
    one.add_argument("--output", metavar="DATASET.nc", help="(default: results/STUDY/tradeoff/STUDY.nc)")
    fitted = "where the line for D is fitted (default: from a tenth of each run to its end)"
    one.add_argument("--fit-window", type=_window, metavar="T0:T1", help=fitted)

    one = _verb(verbs, plan, "brownpipe plan config/harrison2020.yaml --tolerance 2% --write my_study.yaml")
    one.add_argument("study", metavar="STUDY", help="study file (YAML)")
    one.add_argument("--tolerance", metavar="ERROR", help="relative error that will do: 2%% or 0.02")
    names = ("msd", "d", "displacement")
    one.add_argument("--observable", choices=names, help="what it is the error of (default: msd, at the end)")
    one.add_argument("--budget", type=_seconds, metavar="TIME", help="CPU time that may be spent: 60s, 5min, 2h")
    one.add_argument("--write", metavar="FILE.yaml", help="study file to write, with what is best")

    one = _verb(verbs, inspect, "brownpipe inspect seed17.h5")
    one.add_argument("file", metavar="FILE", help="trajectory file or dataset")

    one = _verb(verbs, check, f"brownpipe check {scene}")
    one.add_argument("file", metavar="SCENE|STUDY", help="scene or study file (YAML)")
    one.add_argument("--particles", type=_integer, metavar="N", help="number of disks instead of the scene's")
    return parser


def _verb(verbs, function, example: str) -> argparse.ArgumentParser:
    brief = function.__doc__.partition("\n")[0]
    one = verbs.add_parser(function.__name__, help=brief, description=function.__doc__, epilog=f"example: {example}")
    one.set_defaults(verb=function)
    return one


def _observables(text: str) -> str:
    """Names of observables, with commas; those of earlier versions become today's."""
    from brownpipe.observables import RENAMED
    from brownpipe.scene.reading import Entry, current_name

    names = (current_name(Entry(name, "", ("--observables",)), RENAMED) for name in text.split(","))
    return ",".join(name.value for name in names)


def _window(text: str) -> tuple[float, float]:
    try:
        start, end = map(float, text.split(":"))
    except ValueError:
        start = end = float("nan")
    if not 0 <= start < end < float("inf"):
        raise argparse.ArgumentTypeError(f"must be T0:T1 with 0 <= T0 < T1, like 0.1:1, not {text!r}")
    return start, end


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a finite number > 0, not {text!r}")
    return value


def _seconds(text: str) -> float:
    """Seconds of 60s, 5min, 2h or 60."""
    number = text.rstrip("abcdefghijklmnopqrstuvwxyz")
    units = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}
    if text[len(number) :] not in units:
        raise argparse.ArgumentTypeError(f"must be a time like 60s, 5min or 2h, not {text!r}")
    return _positive(number) * units[text[len(number) :]]


def _integer(text: str, least: int = 0, most: int = 999_999_999) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= 9 and least <= int(text) <= most):
        raise argparse.ArgumentTypeError(f"must be an integer from {least} to {most}, not {text!r}")
    return int(text)


def _rings(text: str) -> int:
    return _integer(text, 1, 100_000)


def _frames(text: str) -> int:
    return _integer(text, 1)
