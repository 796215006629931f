# What several rules need: the study, where its results stand, and what each step is made from.
#
# Files of runs stand in folders that are named after all that determines their runs, shared by all studies: a run that
# is there is always the requested one. Later steps have the digest of what they are made from in the name of a file
# beside their results, `made_from_DIGEST.txt`: if it is missing, the step is due. `drawn_from_DIGEST.txt` lists dataset
# and files of a drawing with their SHA-256: an older one that was put back is not shown. So nothing depends on times of
# modification (inputs are `ancient`, and make a step due only where they are missing, even those that the step before
# it has read) or on what Snakemake remembers (`rerun-triggers: input` in the profile). `ancient` marks the very object
# it is given, so it gets a copy, `str`, of an output's name: rule all has that name, too, and would not be due after
# another step.
from brownpipe.study.workflow import (
    ended_by_mistakes,
    say_forecast,
    read_workflow_study,
    remove_stale_locks,
)
from brownpipe.study.plan import with_planned_seeds
from brownpipe.study.run_sets import commands, digests, figure_options, files_of, job_resources
from brownpipe.provenance import PACKAGE

if workflow.is_main_process:
    remove_stale_locks()
configfiles = workflow.configfiles or [f"{workflow.basedir}/config/harrison2020.yaml"]
study, study_words = read_workflow_study(configfiles, workflow.config_settings.config)
results = f"results/{study.name}"
runs = "results/runs/{scene}/N{particles}/{engine}-{digest}/{first}-{last}"
made_from = digests(study)
any_digest = "[0-9a-f]" * len(made_from["plan"])
simulations = commands(study)
resources_of_jobs = job_resources(study)
captions = PACKAGE / "figures"
awaits_plan = []  # the job that says how many runs there are, until it is done
not_as_made = (
    "echo 'brownpipe: delete what is not as the study made it, and run the study again' >&2; exit 1"
)


wildcard_constraints:
    digest="[0-9a-f]{8}",
    first=r"\d+",
    last=r"\d+",


def exactly(words):
    """Return words for a parameter of a rule such that Snakemake does not take braces in them for wildcards."""

    def unchanged(wildcards):
        return words

    return unchanged


# How many runs the tolerance of a study needs, by pilot runs; a study with `seeds` does without.
checkpoint plan:
    output:
        f"{results}/plan/{made_from['plan']}.yaml",
    log:
        f"{results}/logs/plan.log",
    resources:
        **resources_of_jobs["plan"],
    params:
        study=exactly(study_words),
    shell:
        "brownpipe plan {params.study} --count {output:q} > {log:q} 2>&1"


def plan_file(wildcards):
    """Return the file that says how many runs the study needs, once it is there; none for a study with seeds."""
    return [] if study.tolerance is None else [checkpoints.plan.get().output[0]]


@ended_by_mistakes()
def trajectories(wildcards):
    """Return the files with the runs of the study: those that are there, and those to be made."""
    known = with_planned_seeds(study, *plan_file(wildcards)) if study.tolerance else study
    paths = [file.path for file in files_of(known)]
    if awaits_plan:
        awaits_plan.clear()
        say_forecast(study, [str(path) for path in paths if not path.exists()], logger)
    return [str(path) for path in paths]


@ended_by_mistakes()
def compared(wildcards):
    """Return the files with the runs of a study with engines to compare."""
    study.refuse_tradeoff()
    return trajectories(wildcards)
