# The workflow of a study: simulate -> aggregate -> figures.
#     snakemake -j2                                              the default study, the 2020 note
#     snakemake -j2 --configfile config/small.yaml               another one
#     snakemake -j2 --config seeds=100                           the same with another value of one of its keys
from brownpipe.storage import source_digest
from brownpipe.study import read_study

study = read_study(([*workflow.configfiles] or ["config/harrison2020.yaml"])[-1], workflow.config_settings.config)
results = f"results/{study.name}"
cases = study.table


rule all:
    default_target: True
    input:
        f"{results}/figures/summary.txt",


include: "workflow/rules/simulate.smk"
include: "workflow/rules/aggregate.smk"
include: "workflow/rules/figures.smk"


onsuccess:
    shell("cat {results}/figures/summary.txt")
