rule simulate:
    output:
        f"{runs}.h5",
    log:
        f"{runs}.log",
    resources:
        **resources_of_jobs["simulate"],
    params:
        runs=lookup(dpath="{digest}", within=simulations),
    shell:
        "brownpipe simulate {params.runs} --seeds {wildcards.first}-{wildcards.last} --allow-failed all"
        " --output {output:q} > {log:q} 2>&1"
