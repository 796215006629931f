"""`brownpipe plan`: engine and number of runs for a tolerance."""

import shlex
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from brownpipe.errors import DONE, FAILED, RequestError
from brownpipe.verbs.output import YAML, show, writable
from brownpipe.verbs.values import add_config, typed

EXAMPLE = "config/harrison2020.yaml --tolerance 2% --write my_study.yaml"


def add_arguments(add: Callable) -> None:
    from brownpipe.study.study import Target, Tolerance

    add("study", metavar="STUDY", help="study file (YAML)")
    add("--tolerance", type=typed(Tolerance), metavar="ERROR", help="relative error that is allowed: 2%% or 0.02")
    target = "quantity with this error: msd (at the end; default), d, or displacement_distribution (at the end)"
    add("--target", type=typed(Target), metavar="QUANTITY", help=target)
    add_config(add)
    add("--count", metavar="PLAN.yaml", help="only determine how many runs the tolerance needs, and store it here")
    add("--write", metavar="FILE.yaml", help="study file to write, with the best choice")


def plan(arguments: Namespace) -> int:
    """Find the engine of a study, and the number of runs, that meet a tolerance at the lowest cost.

    From pilot runs of some 4 s of CPU for each engine, scene and number of disks. They are the first runs of the study,
    which uses them again: they are stored in `results/runs` of this folder.
    """
    from brownpipe import progress
    from brownpipe.scene.reading import Name, validated
    from brownpipe.study import read_study
    from brownpipe.study.plan import offers, performance_of, recommendation, spent_on, write_plan, write_study
    from brownpipe.study.study import why_no_relative_error

    study = read_study(arguments.study, dict(arguments.config))
    if arguments.count is not None:
        with progress.shown("plan"):
            runs, pilots = write_plan(study, writable(arguments.count, arguments.study, suffixes=YAML))
        show(f"{arguments.count}: {runs:,} runs for a tolerance of {100 * study.tolerance:g} % of {study.target}")
        show(spent_on(pilots))
        return DONE
    target, tolerance = arguments.target or study.target, arguments.tolerance or study.tolerance
    if tolerance is None:
        raise RequestError("--tolerance: missing; must be given, as the study has none")
    if reason := why_no_relative_error(study.cases):
        raise RequestError(f"{arguments.study}: {reason}, and one run is enough; must be left out of the plan")
    if arguments.write is not None:
        validated(Name, Path(arguments.write).stem, key="--write")  # of the new study
    inputs = (arguments.study, *map(str, study.scenes))
    output = None if arguments.write is None else writable(arguments.write, *inputs, suffixes=YAML)
    with progress.shown("plan"):
        cases, pilots = performance_of(study, target)
    show(*recommendation(cases, target, tolerance).split("\n"))
    best = next(iter(offers(cases, tolerance)), None)
    if output is not None and best is not None:
        write_study(study, arguments.study, output, best, f"brownpipe plan {shlex.join(arguments.argv[1:])}")
        show(f"{output}: a study with this engine and number of runs")
    show(spent_on(pilots))
    return FAILED if best is None else DONE
