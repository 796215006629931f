"""The command line: one verb per step. The only place that prints."""

import argparse
import json
import signal
import sys
from importlib.metadata import version
from pathlib import Path

from brownpipe.scene import SceneError, read_scene

DONE, FAILED, WRONG = 0, 1, 2  # exit status: done, the run failed, the request was wrong
RECORDS = ("tracer", "all", "events", "none")


def main(argv: list[str] | None = None) -> int:
    """Run one verb; return the exit status."""
    arguments = _parser().parse_args(argv)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        return arguments.verb(arguments)
    except KeyboardInterrupt:
        return _say("interrupted", 128 + signal.SIGINT)
    except BrokenPipeError:
        return FAILED
    except Exception as error:
        status = _status_of(error)
        if status is None:
            raise
        return _say(str(error), status)


def _status_of(error: Exception) -> int | None:
    """Return what a failure means for the caller, None if it is a fault of the program."""
    from brownpipe.kernels import RunError
    from brownpipe.storage import StorageError

    if isinstance(error, SceneError):
        return WRONG
    if isinstance(error, RunError | StorageError | OSError | MemoryError):
        return FAILED
    if type(error).__name__ == "AnalysisError":
        return WRONG
    return None


def _say(message: str, status: int) -> int:
    print("brownpipe:", " ".join(message.split()) or "out of memory", file=sys.stderr)
    return status


# -- verbs ----------------------------------------------------------------------------------------------------------


def simulate(arguments) -> int:
    """Run a scene once for every seed and write the trajectories."""
    from brownpipe import exact
    from brownpipe.storage import write_trajectories
    from brownpipe.study import parse_seeds

    scene = read_scene(arguments.scene, arguments.particles)
    seeds = parse_seeds(arguments.seeds)
    words = frozenset(arguments.record.split(","))
    if not words <= set(RECORDS) or ("none" in words and len(words) > 1):
        raise SceneError(f"--record {arguments.record}: must be one or several of {', '.join(RECORDS)} (none alone)")
    output = arguments.output or f"{scene.name}.h5"
    ensemble = exact.simulate(scene, seeds, words | ({"tracer"} - words if "none" not in words else set()))
    write_trajectories(output, scene, "exact", {}, ensemble)
    failed = ensemble.seeds[ensemble.observables["failed"] > 0] if len(ensemble.seeds) else []
    if len(failed):
        return _say(f"{output}: {len(failed)} of {len(seeds)} runs failed their health check: seed {failed[0]}", FAILED)
    return DONE


def aggregate(arguments) -> int:
    """Make one dataset of trajectory files."""
    from brownpipe import analysis
    from brownpipe.storage import write_dataset

    dataset = analysis.aggregate(
        arguments.files, [tuple(window) for window in arguments.fit_windows], arguments.ring_width, arguments.rings
    )
    write_dataset(arguments.output, dataset)
    return DONE


def figures(arguments) -> int:
    """Draw the figures of a dataset, each with its numbers, and the summary."""
    from brownpipe import figures as drawing
    from brownpipe.storage import read_dataset, write_file

    dataset = read_dataset(arguments.dataset)
    drawing.render(dataset, arguments.output)
    write_file(Path(arguments.output) / "summary.txt", drawing.summary(dataset).encode())
    return DONE


def inspect(arguments) -> int:
    """Say what is in a file, and whether it is intact."""
    from brownpipe.storage import describe, verify

    print(describe(arguments.file))
    return FAILED if verify(arguments.file) else DONE


def check(arguments) -> int:
    """Say whether a scene or a study is valid, and what it will model."""
    from brownpipe.study import read_study

    is_study = "scenes" in Path(arguments.file).read_text(errors="replace").split(":")[0].split()
    print(read_study(arguments.file) if is_study else json.loads(read_scene(arguments.file, arguments.particles).text))
    return DONE


# -- the words ------------------------------------------------------------------------------------------------------


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "brownpipe", description="Hard disks that collide exactly, a heavy one among them that wanders."
    )
    parser.add_argument("--version", action="version", version=f"brownpipe {version('brownpipe')}")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    scene = "config/scenes/harrison2020.yaml"

    one = _verb(verbs, simulate, f"brownpipe simulate {scene} --seeds 17 --record all --output seed17.h5")
    one.add_argument("scene", metavar="SCENE", help="scene file (YAML)")
    one.add_argument("--particles", type=int, metavar="N", help="number of disks instead of the scene's")
    one.add_argument("--seeds", default="0", help="0-2399, 17 or 3,5,9 (default 0)")
    one.add_argument("--engine", choices=["exact"], default="exact")
    one.add_argument("--record", default="tracer", help="tracer (default), all, events, none; several with commas")
    one.add_argument("--output", metavar="FILE.h5", help="trajectory file (default: the scene's name here)")

    one = _verb(verbs, aggregate, "brownpipe aggregate results/run/*.h5 --output run.nc")
    one.add_argument("files", nargs="+", metavar="FILE", help="trajectory files of one study, in any order")
    one.add_argument("--output", required=True, metavar="DATASET.nc")
    one.add_argument("--fit-windows", nargs="+", type=_window, default=[(0.1, 1.0), (0.5, 1.0)], metavar="T0:T1")
    one.add_argument("--ring-width", type=float, default=0.04, metavar="DR", help="of the displacement distribution")
    one.add_argument("--rings", type=int, default=24, metavar="COUNT")

    one = _verb(verbs, figures, "brownpipe figures run.nc --output figures")
    one.add_argument("dataset", metavar="DATASET.nc")
    one.add_argument("--output", required=True, metavar="DIR")

    one = _verb(verbs, inspect, "brownpipe inspect seed17.h5")
    one.add_argument("file", metavar="FILE", help="trajectory file or dataset")

    one = _verb(verbs, check, f"brownpipe check {scene}")
    one.add_argument("file", metavar="SCENE|STUDY")
    one.add_argument("--particles", type=int, metavar="N")
    return parser


def _verb(verbs, function, example: str) -> argparse.ArgumentParser:
    described = {"help": function.__doc__, "description": function.__doc__, "epilog": f"example: {example}"}
    one = verbs.add_parser(function.__name__, **described)
    one.set_defaults(verb=function)
    return one


def _window(text: str) -> tuple[float, float]:
    start, end = map(float, text.split(":"))
    return start, end
