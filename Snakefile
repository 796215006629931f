# The workflow of a study: simulate -> aggregate -> figures -> its summary on the screen.
#     snakemake -j2                                              the default study, the 2020 note
#     snakemake -j2 --configfile config/small.yaml               another study
#     snakemake -j2 --config seeds=100                           another value of a key, with results of its own
#     snakemake tradeoff_figures -j2 --configfile config/tradeoff.yaml     cost and accuracy of its engines
#     snakemake --report report.html                             Snakemake's own report: results, commands, times
include: "workflow/rules/common.smk"
include: "workflow/rules/simulate.smk"
include: "workflow/rules/aggregate.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/tradeoff.smk"


report: "workflow/report/study.rst"


# All files of a study are inputs here, so that what a failed job left missing, or somebody deleted, is made again. This
# rule has no output and so always runs: the summary is the last thing on the screen, but for a line on runs that failed.
# If these are more than the study allows, only this rule fails: the results are there, and the next run says it again.
rule all:
    default_target: True
    input:
        rules.figures.output,
        rules.aggregate.output,
        trajectories,
        summary=rules.figures.output.summary,
        dataset=rules.aggregate.output.dataset,
        page=rules.figures.output.page,
        drawn_from=rules.figures.output.drawn_from,
    localrule: True  # on a cluster, too, its output is for the screen here
    params:
        not_as_made=not_as_made,
        allow_failed=study.allow_failed,
    shell:
        "sha256sum --check --quiet {input.drawn_from:q} >&2 || {{ {params.not_as_made}; }}"
        ' && cat {input.summary:q} && echo figures and tables: "$(dirname {input.summary:q})"'
        " && echo all on one page: {input.page:q}"
        " && brownpipe inspect {input.dataset:q} --allow-failed {params.allow_failed}"


onstart:
    due = [*workflow.dag.needrun_jobs()]
    awaits_plan.extend(job for job in due if job.rule.name == "plan")
    say_forecast(study, [job.output[0] for job in due if job.rule.name == "simulate"], logger)
