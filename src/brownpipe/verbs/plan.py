"""`brownpipe plan`: engine and number of runs for a tolerance or a CPU time."""

import argparse
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from brownpipe.errors import DONE, FAILED, RequestError
from brownpipe.quoting import shell_word
from brownpipe.verbs.output import YAML, say, show, writable
from brownpipe.verbs.values import seconds

EXAMPLE = "config/harrison2020.yaml --tolerance 2% --write my_study.yaml"


def add_arguments(add: Callable) -> None:
    add("study", metavar="STUDY", help="study file (YAML)")
    add("--tolerance", metavar="ERROR", help="relative error that is allowed: 2%% or 0.02")
    target = "quantity with this error: msd (at the end; default), d, or displacement_distribution (at the end)"
    add("--target", metavar="QUANTITY", help=target)
    add("--observable", help=argparse.SUPPRESS)  # the old name of --target
    add("--budget", type=seconds, metavar="TIME", help="CPU time that may be spent: 60s, 5min, 2h")
    add("--write", metavar="FILE.yaml", help="study file to write, with the best choice")


def plan(arguments: Namespace) -> int:
    """Find the engine and number of runs that meet a tolerance at the lowest cost, or the best accuracy for a CPU time.

    Uses stored results of `brownpipe tradeoff` that have the same scenes, otherwise pilot runs of some seconds.
    """
    from brownpipe import progress
    from brownpipe.scene.reading import Entry
    from brownpipe.scene.reading import name as read_name
    from brownpipe.study import performance, read_study, writing
    from brownpipe.study import plan as planning
    from brownpipe.study.offers import offers
    from brownpipe.study.study_file import why_no_relative_error

    study, budget = read_study(arguments.study), arguments.budget
    tolerance, target = study.tolerance, _target(arguments) or study.target or "msd"
    if arguments.tolerance is not None:
        tolerance = planning.tolerance_of(arguments.tolerance)
    if tolerance is None and budget is None:
        raise RequestError("--tolerance: missing; must be given, or --budget")
    if reason := why_no_relative_error(study.cases):
        raise RequestError(f"{arguments.study}: {reason}, and one run is enough; must be left out of the plan")
    if arguments.write is not None:
        read_name(Entry(Path(arguments.write).stem, "", ("--write",)))  # of the new study
    inputs = (arguments.study, *map(str, study.scenes))
    output = None if arguments.write is None else writable(arguments.write, *inputs, suffixes=YAML)
    with progress.shown("plan"):
        cases = performance.performance_of(study, target)
    show(*planning.recommendation(cases, target, tolerance, budget).split("\n"))
    best = next(iter(offers(cases, tolerance, budget)), None)
    if output is not None and best is not None:
        mapping = writing.derived_study(arguments.study, output, best.engine, best.runs)
        writing.write_yaml(output, mapping, " ".join(["brownpipe plan", *map(shell_word, arguments.argv[1:])]))
    return FAILED if best is None else DONE


def _target(arguments: Namespace) -> str | None:
    """Return the quantity of --target, or of --observable, its old name; None if neither is given."""
    from brownpipe.scene.reading import Entry
    from brownpipe.study.study_file import read_target

    options = {f"--{name}": getattr(arguments, name) for name in ("target", "observable")}
    options = {option: value for option, value in options.items() if value is not None}
    if len(options) > 1:
        raise RequestError("--observable: is the old name of --target; must be given once")
    if "--observable" in options:
        say("--observable: now called --target", DONE)
    return next((read_target(Entry(value, "", (option,))) for option, value in options.items()), None)
