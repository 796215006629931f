"""`brownpipe run`: the whole workflow of a study."""

from argparse import Namespace
from collections.abc import Callable
from functools import partial
from pathlib import Path

from brownpipe.errors import DONE, RequestError
from brownpipe.verbs import verify
from brownpipe.verbs.output import show
from brownpipe.verbs.values import integer

EXAMPLE = "my_study.yaml -j 2 --report"
PASSES_ON = True  # the arguments after `--`


def add_arguments(add: Callable) -> None:
    add("study", metavar="STUDY", help="study file (YAML)")
    jobs = "jobs at the same time (default: number of cores)"
    add("-j", "--cores", type=partial(integer, least=1), metavar="N", help=jobs)
    places = "run the jobs on a cluster: slurm, or a folder with a profile of Snakemake"
    add("--profile", metavar="NAME", help=places).words = ("slurm",)
    listed = "only say which jobs would run, and what differs from the results that exist"
    add("-n", "--dry-run", action="store_true", help=listed)
    page = "afterwards write Snakemake's report, with commands and run times (default: report.html)"
    add("--report", nargs="?", const="report.html", metavar="FILE", help=page)
    add("--verify", action="store_true", help="afterwards verify all results, as `brownpipe verify` does")


def run(arguments: Namespace) -> int:
    """Run a study: simulate, aggregate, figures, with the results in `results` of this folder.

    A second run has nothing to do; after a change only the steps that depend on it run again. Further arguments after
    `--` are passed to Snakemake: `brownpipe run my_study.yaml -- --config seeds=100`. With -n and such arguments
    Snakemake lists every job with its command and its reasons: `brownpipe run my_study.yaml -n -- --printshellcmds`.
    """
    from brownpipe import progress
    from brownpipe.study import read_study
    from brownpipe.study.changes import changes
    from brownpipe.study.workflow import is_changed_by, planned_jobs, run_study

    further = arguments.further
    status = DONE
    if arguments.verify and arguments.dry_run:
        raise RequestError("--verify: must not be given with -n, which runs nothing")
    if arguments.dry_run and not further and arguments.report is None:
        show(planned_jobs(arguments.study, arguments.cores, arguments.profile))
    else:
        report, profile = arguments.report, arguments.profile
        status = run_study(arguments.study, arguments.cores, arguments.dry_run, report, further, profile)
    if status == DONE and arguments.dry_run and not is_changed_by(further):
        study = read_study(arguments.study)
        for line in changes(study):
            show(f"differs from results/{study.name}: {line}")
    if status == DONE and arguments.verify:
        with progress.shown("verify"):
            status = verify.report(f"results/{Path(arguments.study).stem}")
    return status
