"""`brownpipe run`: the whole workflow of a study."""

from argparse import Namespace
from collections.abc import Callable

from brownpipe.verbs.values import typed

EXAMPLE = "my_study.yaml -j 2"
PASSES_ON = True  # arguments that it does not know, and those after `--`


def add_arguments(add: Callable) -> None:
    from brownpipe.scene.reading import AtLeastOne

    add("study", metavar="STUDY", help="study file (YAML)")
    jobs = "jobs at the same time (default: number of cores)"
    add("-j", "--cores", type=typed(AtLeastOne), metavar="N", help=jobs)
    places = "run the jobs on a cluster: slurm, or a folder with a profile of Snakemake"
    add("--profile", metavar="NAME", help=places)


def run(arguments: Namespace) -> int:
    """Run a study: simulate, aggregate, figures, with the results in `results` of this folder.

    A second run has nothing to do; after a change only the steps that depend on it run again. All other options are
    those of Snakemake: `-n` lists the jobs that are due and why, `--config seeds=100` replaces a key of the study,
    `--report report.html` writes Snakemake's report of results that are there.
    """
    from brownpipe.study.workflow import run_study

    return run_study(arguments.study, arguments.cores, arguments.profile, arguments.further)
