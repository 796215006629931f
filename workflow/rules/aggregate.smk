rule aggregate:
    input:
        ancient(trajectories),
        plan=ancient(plan_file),
    output:
        dataset=f"{results}/aggregate/{study.name}.nc",
        made_from=f"{results}/aggregate/made_from_{made_from['aggregate']}.txt",
    log:
        f"{results}/logs/aggregate.log",
    resources:
        **resources_of_jobs["aggregate"],
    params:
        study=exactly(study_words),
        any_digest=any_digest,
        planned=made_from["aggregate"],
    shell:
        'rm -f "$(dirname {output.dataset:q})"/made_from_{params.any_digest}.txt'
        " && brownpipe aggregate --study {params.study} --plan {input.plan:q} --output {output.dataset:q}"
        " --planned {params.planned} --list-runs {output.made_from:q} > {log:q} 2>&1"
