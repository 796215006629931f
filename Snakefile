# The workflow of a study: simulate -> aggregate -> figures -> its summary on the screen.
#     snakemake -j2                                              the default study, the 2020 note
#     snakemake -j2 --configfile config/small.yaml               another study
#     snakemake -j2 --config seeds=100                           the default study with another value of a key
#     snakemake tradeoff_figures -j2 --configfile config/tradeoff.yaml     cost and accuracy of its engines
#     snakemake --report report.html                             Snakemake's own report: results, commands, times
import atexit
import gc
import json
import sys
from os.path import relpath

from brownpipe.errors import RequestError
from brownpipe.provenance import PACKAGE, made_with
from brownpipe.quoting import shell_path
from brownpipe.study import from_command_line, read_study
from brownpipe.study.replay import replay_files
from brownpipe.study.resources import cores_of_aggregate, requests

gc.set_threshold(500_000)  # as the command line does: Python searches its memory for garbage less often,
atexit.register(gc.freeze)  # and not at all when it ends
try:
    study_file = relpath([f"{workflow.basedir}/config/harrison2020.yaml", *workflow.configfiles][-1])
    overrides = workflow.config_settings.config
    study = read_study(study_file, from_command_line(overrides))
    if study.tolerance is not None:
        from brownpipe.study.run_count import settle

        dry_run = workflow.output_settings.dryrun
        study = settle(study, f"results/{study.name}/plan.yaml", logger.info, dry_run)
except RequestError as error:
    sys.exit(f"brownpipe: {error}")
except KeyboardInterrupt:
    sys.exit("brownpipe: interrupted")
seen = {key: value for key, value in overrides.items() if key not in ("figures", "allow_failed")}  # by the analysis
settings = ["--config", *(f"{key}={json.dumps(value)}" for key, value in seen.items())] if seen else []
results = f"results/{study.name}"
batch = "{scene}/N{particles}/{engine}/{first}-{last}"  # file of a job of simulate, without suffix
trajectories = [f"{results}/simulate/{job.file}" for job in study.jobs()]
captions = PACKAGE / "figures"
replay = [file for file, _ in replay_files(study)]  # one run, or none
cases = study.case_table
request = requests(study)
engines = {
    engine.label: {"options": engine.options, "made_with": made_with("simulate", engine.name)}
    for engine in study.engines
}


report: "workflow/report/study.rst"


include: "workflow/rules/compile.smk"
include: "workflow/rules/simulate.smk"
include: "workflow/rules/aggregate.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/tradeoff.smk"
include: "workflow/rules/replay.smk"


# All files of a study are inputs here, so that what a failed job left missing, or somebody deleted, is made again:
# Snakemake takes results for up to date if a file that they were made from is missing. This rule has no output and so
# always runs: the summary is the last thing on the screen, but for a line on runs that failed. If these are more than
# the study allows, only this rule fails: the results are there, and the next run says the same again.
rule all:
    default_target: True
    input:
        rules.figures.output,
        rules.aggregate.input,
        replay,
        summary=rules.figures.output.summary,
        dataset=rules.aggregate.output[0],
        page=rules.figures.output.page,
    localrule: True  # on a cluster, too, its output is for the screen here
    params:
        allow_failed=study.allow_failed,
    shell:
        'cat {input.summary:q} && echo figures and tables: "$(dirname {input.summary:q})"'
        " && echo all on one page: {input.page:q}"
        " && brownpipe inspect {input.dataset:q} --allow-failed {params.allow_failed}"


onstart:
    from brownpipe.storage.finished import set_aside
    from brownpipe.study.resources import needs_of_simulation
    from brownpipe.study.run_record import RunRecord, write_run_record
    from brownpipe.study.workload import describe_workload

    if workflow.local_exec:  # no queue has to be spared, and Python would wait for the last timer of the limiter
        workflow.scheduler.job_rate_limiter = None
    write_run_record(results, RunRecord(study_file, overrides))
    to_do = [job for job in workflow.dag.needrun_jobs() if job.rule.name == "simulate"]
    for job in to_do:
        set_aside(job.output[0])  # Snakemake would delete a batch that was finished after an interruption
    runs = sum(int(job.wildcards.last) - int(job.wildcards.first) + 1 for job in to_do)
    needs = {f"{results}/simulate/{file}": need for file, need in needs_of_simulation(study).items()}
    seconds = {job.output[0]: needs[job.output[0]].seconds for job in to_do}
    workload = f"brownpipe: the study {study.name}: {describe_workload(study)}"
    logger.info(workload, extra={"forecast": True, "runs": runs, "seconds": seconds})


onsuccess:
    from brownpipe.study.resources import describe_used

    if not workflow.local_exec:  # on one machine a request has no effect, and the answer stays the last thing said
        logger.info(f"brownpipe: the study {study.name}: {describe_used(study)}")
