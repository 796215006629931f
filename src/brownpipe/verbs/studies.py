"""The verbs of a study: a new one, what it will cost, the whole workflow, and the runs that a
tolerance needs.
"""

import json
import shlex
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

from brownpipe import progress
from brownpipe.errors import DONE, FAILED, RequestError
from brownpipe.provenance import PACKAGE
from brownpipe.scene import Scene
from brownpipe.scene.reading import AtLeastOne, Name, validated
from brownpipe.storage.files import write_file
from brownpipe.study import Study, read_study
from brownpipe.study.budget import (
    Budget,
    best_offer,
    describe_budget,
    errors_within,
    paid_offers,
)
from brownpipe.study.check import describe_scene_or_study
from brownpipe.study.plan import (
    Offer,
    Pilot,
    offers,
    performance_of,
    recommendation,
    spent_on,
    tolerance_of,
    write_plan,
    write_study,
)
from brownpipe.study.study import Target, Tolerance, read_keys, why_no_relative_error
from brownpipe.study.workflow import pipeline_folder, require_snakemake, run_study
from brownpipe.text import shell_path
from brownpipe.verbs import AddOption, Verb
from brownpipe.verbs.options import add_config, add_particles, refuse_together, typed
from brownpipe.verbs.output import YAML, absent, writable
from brownpipe.verbs.screen import show


def _new_options(add: AddOption) -> None:
    add("name", metavar="NAME", help="name of the study")
    add(
        "--folder",
        default=".",
        metavar="FOLDER",
        help="where to write the files (default: this folder)",
    )


def write_new_study(arguments: Namespace) -> None:
    """Write a commented scene and study to start from: NAME_scene.yaml and NAME.yaml.

    They run as they are, in half a minute: a heavy disk among 199 and among 399 light ones, 300
    runs each.

    example: brownpipe new my_study
    """
    require_snakemake()
    name = arguments.name.removesuffix(".yaml")
    validated(Name, f"{name}_scene", key="name of the scene")
    folder = Path(arguments.folder)
    scene = folder / f"{name}_scene.yaml"
    study = folder / f"{name}.yaml"
    for path in (scene, study):
        absent(path, "choose another name or folder")
    templates = PACKAGE / "study" / "templates"
    for path, template in ((scene, "scene.yaml"), (study, "study.yaml")):
        contents = (templates / template).read_bytes()
        write_file(path, contents.replace(b"NAME", name.encode()))
    show(f"{scene}: the physics of one run", f"{study}: the runs and their analysis", "")
    show(f"brownpipe check {shell_path(study)}    # what will be simulated, at what cost")
    show(f"brownpipe run {shell_path(study)}      # results and figures in results/{study.stem}")
    show(f"all keys: {pipeline_folder() / 'config' / 'README.md'}")


def _check_options(add: AddOption) -> None:
    add("file", metavar="SCENE|STUDY", help="scene or study file (YAML)")
    add_particles(add)


def describe_file(arguments: Namespace) -> None:
    """Say whether a scene or study is valid, what will be simulated, and what it will cost.

    Observables of your own are called once, for one run of the first seed.

    example: brownpipe check config/scenes/harrison2020.yaml
    """
    with progress.shown("check"):
        description = describe_scene_or_study(arguments.file, arguments.particles)
    show(*description.split("\n"))


def _run_options(add: AddOption) -> None:
    add("study", metavar="STUDY", help="study file (YAML)")
    jobs = "jobs at the same time (default: number of cores)"
    add("-j", "--cores", type=typed(AtLeastOne), metavar="N", help=jobs)
    places = "run the jobs on a cluster: slurm, or a folder with a profile of Snakemake"
    add("--profile", metavar="NAME", help=places)


def run_workflow(arguments: Namespace) -> int:
    """Run a study: simulate, aggregate, figures, with the results in `results` of this folder.

    A second run has nothing to do; after a change only the steps that depend on it run again. All
    other options are those of Snakemake: `-n` lists the jobs that are due and why, `--config
    seeds=100` replaces a key of the study, `--report report.html` writes Snakemake's report of
    results that are there.

    example: brownpipe run my_study.yaml -j 2
    """
    return run_study(arguments.study, arguments.cores, arguments.profile, arguments.further)


class Choice(NamedTuple):
    """What a plan recommends, and why."""

    offer: Offer | None
    description: str  # a table of engines and cases, and the recommendation
    pilots: list[Pilot]


def _plan_options(add: AddOption) -> None:
    add("study", metavar="STUDY", help="study file (YAML)")
    add(
        "--tolerance",
        type=typed(Tolerance),
        metavar="ERROR",
        help="relative error that is allowed: 2%% or 0.02",
    )
    add(
        "--budget",
        type=typed(Budget),
        metavar="TIME",
        help="CPU time to spend, in place of a tolerance: 60s, 5min or 2h",
    )
    target = (
        "quantity with this error, or the smallest one: msd (at the end; default), d, or "
        "displacement_distribution (at the end)"
    )
    add("--target", type=typed(Target), metavar="QUANTITY", help=target)
    add_config(add)
    add(
        "--count",
        metavar="PLAN.yaml",
        help="only determine how many runs the tolerance needs, and store it here",
    )
    add("--write", metavar="FILE.yaml", help="study file to write, with the best choice")


def plan_study(arguments: Namespace) -> int:
    """Find the engine of a study, and the number of runs, that meet a tolerance at the lowest cost.

    With --budget: the number of runs that a CPU time pays in each case, with each engine alone, and
    the errors of MSD and D that they should have. The starts of further jobs than one for each case
    are not counted, half a second each.

    From pilot runs, up to 4 s of CPU or 400 of them for each engine, scene and number of disks.
    They are the first runs of the study, which uses them again: they are stored in `results/runs`
    of this folder. There are ten or more, for D a hundred, also where these take longer than the
    budget.

    example: brownpipe plan config/harrison2020.yaml --tolerance 2% --write my_study.yaml
    """
    for option in ("tolerance", "budget", "target", "write"):
        refuse_together(arguments, option, "count")
    refuse_together(arguments, "budget", "tolerance")
    config = dict(arguments.config)
    study = read_study(arguments.study, config)
    if arguments.count is not None:
        _count_runs(study, arguments)
        return DONE
    target = arguments.target or study.target
    choose: Callable[[], Choice]
    if arguments.budget is None:
        choose = partial(_meet, study, _asked_tolerance(study, arguments), target)
    else:
        choose = partial(_spend, study, arguments.budget, target)
    reason = why_no_relative_error(study.cases)
    if reason:
        raise RequestError(
            f"{arguments.study}: {reason}, and one run is enough; must be left out of the plan"
        )
    output = arguments.write
    if output:
        validated(Name, Path(output).stem, key="--write")  # of the new study
        output = writable(absent(output, "choose another name"), suffixes=YAML)
    choice = choose()
    show(*choice.description.split("\n"))
    if output and choice.offer is not None:
        comment = f"brownpipe plan {shlex.join(arguments.argv[1:])}"
        keys = read_keys(arguments.study, config)
        write_study(study, keys, output, choice.offer, comment)
        show(f"{output}: a study with this engine and number of runs")
    show(spent_on(choice.pilots))
    return FAILED if choice.offer is None else DONE


def _asked_tolerance(study: Study, arguments: Namespace) -> float:
    """Return the tolerance of the command line or, without one, of the study."""
    tolerance: float | None = arguments.tolerance or study.tolerance
    if tolerance is None:
        raise RequestError("--tolerance: missing; must be given, as the study has none")
    return tolerance


def _meet(study: Study, tolerance: float, target: str) -> Choice:
    """Return the cheapest engine and number of runs for a tolerance."""
    with progress.shown("plan"):
        performances, pilots = performance_of(study, target, tolerance)
    best = next(iter(offers(performances)), None)
    description = recommendation(performances, pilots, target, tolerance)
    return Choice(best, description, pilots)


def _spend(study: Study, budget: float, target: str) -> Choice:
    """Return the engine and number of runs with the smallest error in a CPU time [s]."""
    paid_for = paid_offers(study, budget)
    with progress.shown("plan"):
        paid, pilots = errors_within(study, paid_for, target)
    best = best_offer(study, paid, target)
    description = describe_budget(study, budget, paid_for, paid, pilots, target)
    return Choice(best, description, pilots)


def _count_runs(study: Study, arguments: Namespace) -> None:
    """Determine and store how many runs the tolerance of a study needs."""
    goal = f"a tolerance of {100 * tolerance_of(study):g} % of {study.target}"
    with progress.shown("plan"):
        path = writable(arguments.count, arguments.study, suffixes=YAML)
        runs, pilots = write_plan(study, path)
    show(f"{arguments.count}: {runs:,} runs for {goal}")
    show(spent_on(pilots))


def _schema_options(add: AddOption) -> None:
    add("kind", choices=("scene", "study"), metavar="scene|study", help="the kind of file")


def print_schema(arguments: Namespace) -> None:
    """Print the JSON Schema of scene or study files, with which editors complete and check their
    keys.

    An editor with a YAML language server reads it if the file begins with a comment that says where
    it is:
    # yaml-language-server: $schema=study.json

    example: brownpipe schema study
    """
    record = Scene if arguments.kind == "scene" else Study
    text = json.dumps(record.model_json_schema(), indent=1)
    show(*text.split("\n"))


NEW = Verb("new", write_new_study, _new_options)
CHECK = Verb("check", describe_file, _check_options)
RUN = Verb("run", run_workflow, _run_options)
PLAN = Verb("plan", plan_study, _plan_options)
SCHEMA = Verb("schema", print_schema, _schema_options)
