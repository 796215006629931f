# The kernels of all runs, once, before many jobs begin on a cluster at the same time: `brownpipe run --profile` asks for
# this rule first. No other rule needs it, as every run compiles what is missing; so results never depend on it.
rule compile:
    log:
        f"{results}/logs/compile/{study.name}.log",
    params:
        study=(shell_path(study_file),),
        config=settings,
    shell:
        "brownpipe compile {params.study} {params.config:q} > {log:q} 2>&1"
