"""The arguments of the command line: every verb with its options, and how their values are read.

A verb is a function of `cli`. Its arguments are added by the function listed for it in ARGUMENTS, which takes
`add_argument` of the verb's parser. Values that are valid only for some scenes or studies are checked by the verb.
"""

import argparse
from collections.abc import Callable, Iterable, Sequence
from typing import NoReturn

from brownpipe.errors import WRONG_REQUEST
from brownpipe.figures.catalogue import FIGURES

SCENE = "config/scenes/harrison2020.yaml"  # of the examples


def build_parser(verbs: Iterable[Callable], argv: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser of a command line. A verb is a function: its name is the word, its docstring the help.

    Only the verb that `argv` begins with gets its arguments: those of `simulate` take time, as they import all engines.
    """
    parser = _Parser("brownpipe", description="Exact dynamics of hard disks, with a heavy one among light ones.")
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    subparsers = parser.add_subparsers(metavar="VERB", required=True)
    for verb in verbs:
        add_arguments, example = ARGUMENTS[verb.__name__]
        brief, epilog = verb.__doc__.partition("\n")[0], f"example: brownpipe {verb.__name__} {example}"
        subparser = subparsers.add_parser(verb.__name__, help=brief, description=verb.__doc__, epilog=epilog)
        subparser.set_defaults(verb=verb)
        if verb.__name__ in argv[:1]:
            add_arguments(subparser.add_argument)
    return parser


class _Parser(argparse.ArgumentParser):
    """An argparse parser whose error messages are one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(WRONG_REQUEST, f"{self.prog}: {' '.join(message.split())} (see {self.prog} --help)\n")


class _Version(argparse.Action):
    """Look up the version only if it is to be shown."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from importlib.metadata import version

        print("brownpipe", version("brownpipe"))
        parser.exit()


# -- the arguments of each verb -------------------------------------------------------------------------------------


def _simulate(add: Callable) -> None:
    add("scene", metavar="SCENE", help="scene file (YAML)")
    add("--particles", type=_integer, metavar="N", help="number of disks instead of the scene's")
    add("--seeds", default="0", help="0-2399, 17 or 3,5,9 (default: 0)")
    _add_engines(add)
    add("--record", default="tracer", metavar="WHAT", help="tracer (default), all, events, none; all,events")
    _add_observables(add)
    over = "runs (default), or all time origins or equal disks of a run"
    add("--average", default="runs", metavar="OVER", help=over)
    add("--output", metavar="FILE.h5", help="trajectory file (default: name of the scene, in this folder)")
    add("--checkpoint-every", type=_positive, metavar="SECONDS", help="store checkpoints, to resume a killed run")


def _add_observables(add: Callable) -> None:
    """Add the option --observables, with the names of all of them in its help."""
    from brownpipe.observables import OBSERVABLES

    measured = f"what to measure in each run, with commas: some of {', '.join(OBSERVABLES)}"
    add("--observables", type=_observables, metavar="NAMES", help=measured)


def _add_engines(add: Callable) -> None:
    """Add the option --engine and one option for each setting of each engine; the first engine is the default."""
    from brownpipe.engines import DEFINITIONS, option

    first, *others = DEFINITIONS.values()
    names = [f"{first.name} (default): {first.summary}", *(f"{other.name}: {other.summary}" for other in others)]
    add("--engine", default=first.name, metavar="NAME", help="; ".join(names))
    for definition in DEFINITIONS.values():
        for key, setting in definition.settings.items():
            read = _positive if setting.is_positive else str
            add(option(key), type=read, metavar=setting.metavar, help=f"of {definition.name}: {setting.help}")


def _aggregate(add: Callable) -> None:
    add("files", nargs="+", metavar="FILE.h5", help="trajectory files of one study, in any order")
    add("--output", required=True, metavar="DATASET.nc")
    windows = "where lines are fitted to the MSD (default: 0.1:1 0.5:1)"
    add("--fit-windows", nargs="+", type=_window, metavar="T0:T1", help=windows)
    width = "of the displacement distribution, with --rings (default: from the data)"
    add("--ring-width", type=_positive, metavar="DR", help=width)
    times = "of the displacement distribution (default: the end of each run)"
    add("--displacement-times", nargs="+", type=_positive, metavar="T", help=times)
    add("--rings", type=_rings, metavar="COUNT", help="of the displacement distribution, with --ring-width")


def _figures(add: Callable) -> None:
    add("dataset", metavar="DATASET.nc")
    add("--output", required=True, metavar="FOLDER")
    names = f"some of {', '.join(FIGURES)} (default: all)"
    add("--figures", nargs="+", choices=FIGURES, metavar="NAME", help=names)
    add("--particles", type=_integer, metavar="N", help="show the runs with this many disks (default: 150)")


def _movie(add: Callable) -> None:
    add("file", metavar="FILE.h5", help="trajectory file with whole runs (simulate --record all)")
    add("--seed", type=_integer, metavar="SEED", help="the run to show (default: the first in the file)")
    add("--output", metavar="FILE", help="*.gif, *.mp4 or *.png (default: name of the file, .gif)")
    add("--frames", type=_frames, metavar="COUNT", help="samples to show (default: all)")
    add("--fps", type=_positive, default=25.0, help="frames a second (default: 25)")


def _tradeoff(add: Callable) -> None:
    add("study", metavar="STUDY", help="study file (YAML)")
    add("--files", nargs="+", metavar="FILE.h5", help="trajectory files (default: those of the study)")
    add("--output", metavar="DATASET.nc", help="(default: results/STUDY/tradeoff/STUDY.nc)")
    window = "where the line for D is fitted (default: from a tenth of each run to its end)"
    add("--fit-window", type=_window, metavar="T0:T1", help=window)


def _plan(add: Callable) -> None:
    add("study", metavar="STUDY", help="study file (YAML)")
    add("--tolerance", metavar="ERROR", help="relative error that is allowed: 2%% or 0.02")
    target = "quantity with this error: msd (at the end; default), d, or displacement_distribution (at the end)"
    add("--target", metavar="QUANTITY", help=target)
    add("--observable", help=argparse.SUPPRESS)  # the old name of --target
    add("--budget", type=_seconds, metavar="TIME", help="CPU time that may be spent: 60s, 5min, 2h")
    add("--write", metavar="FILE.yaml", help="study file to write, with the best choice")


def _inspect(add: Callable) -> None:
    add("file", metavar="FILE", help="trajectory file or dataset")


def _check(add: Callable) -> None:
    add("file", metavar="SCENE|STUDY", help="scene or study file (YAML)")
    add("--particles", type=_integer, metavar="N", help="number of disks instead of the scene's")


ARGUMENTS = {  # verb: (function that adds its arguments, an example of them)
    "simulate": (_simulate, f"{SCENE} --seeds 17 --record all --output seed17.h5"),
    "aggregate": (_aggregate, "results/small/simulate/*/*/*/*.h5 --output small.nc"),
    "figures": (_figures, "small.nc --output figures"),
    "movie": (_movie, "seed17.h5 --output seed17.gif"),
    "tradeoff": (_tradeoff, "config/tradeoff.yaml"),
    "plan": (_plan, "config/harrison2020.yaml --tolerance 2% --write my_study.yaml"),
    "inspect": (_inspect, "seed17.h5"),
    "check": (_check, SCENE),
}


# -- values of arguments --------------------------------------------------------------------------------------------
# Each function raises ArgumentTypeError, which argparse shows with the name of the option.


def _observables(text: str) -> str:
    """Return names of observables, separated by commas; names of earlier versions are replaced by the current ones."""
    from brownpipe.observables import RENAMED
    from brownpipe.scene.reading import Entry, current_name

    names = (current_name(Entry(name, "", ("--observables",)), RENAMED) for name in text.split(","))
    return ",".join(str(name.value) for name in names)


def _window(text: str) -> tuple[float, float]:
    """Return the start and end [time] of T0:T1."""
    try:
        start, end = map(float, text.split(":"))
    except ValueError:
        start = end = float("nan")
    if not 0 <= start < end < float("inf"):
        raise argparse.ArgumentTypeError(f"must be T0:T1 with 0 <= T0 < T1, like 0.1:1, not {text!r}")
    return start, end


def _positive(text: str) -> float:
    """Return a finite number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a finite number > 0, not {text!r}")
    return value


def _seconds(text: str) -> float:
    """Return the seconds of 60s, 5min, 2h or 60."""
    number = text.rstrip("abcdefghijklmnopqrstuvwxyz")
    units = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}
    if text[len(number) :] not in units:
        raise argparse.ArgumentTypeError(f"must be a time like 60s, 5min or 2h, not {text!r}")
    return _positive(number) * units[text[len(number) :]]


def _integer(text: str, least: int = 0, most: int = 999_999_999) -> int:
    """Return an integer written in at most nine ASCII digits, from `least` to `most`."""
    if not (text.isascii() and text.isdigit() and len(text) <= 9 and least <= int(text) <= most):
        raise argparse.ArgumentTypeError(f"must be an integer from {least} to {most}, not {text!r}")
    return int(text)


def _rings(text: str) -> int:
    return _integer(text, 1, 100_000)


def _frames(text: str) -> int:
    return _integer(text, 1)
