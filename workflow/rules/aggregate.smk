rule aggregate:
    input:
        trajectories,
    output:
        f"{results}/aggregate/{study.name}.nc",
    log:
        f"{results}/logs/aggregate/{study.name}.log",
    benchmark:
        f"{results}/benchmarks/aggregate/{study.name}.tsv"
    threads: cores_of_aggregate(study)
    resources:
        **request["aggregate"],
    params:
        study=(shell_path(study_file),),
        config=settings,
        windows=[f"{start}:{end}" for start, end in study.fit_windows],
        options=study.aggregate_options,
        made_with=made_with("aggregate"),
    shell:
        "brownpipe aggregate --study {params.study} {params.config:q} --output {output:q} --fit-windows {params.windows:q}"
        " {params.options} --cores {threads} 2> {log:q}"
