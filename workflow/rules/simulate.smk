# Parameters, not inputs: the path of the scene file and the digest of its physics. Editing a comment reruns nothing.
rule simulate:
    output:
        f"{results}/simulate/{batch}.h5",
    log:
        f"{results}/logs/simulate/{batch}.log",
    benchmark:
        f"{results}/benchmarks/simulate/{batch}.tsv"
    resources:
        **request["simulate"],
    params:
        scene=lookup(dpath="{scene}/{particles}/file", within=cases),
        physics=lookup(dpath="{scene}/{particles}/digest", within=cases),
        engine=lookup(dpath="{engine}/options", within=engines),
        options=study.simulate_options,
        made_with=lookup(dpath="{engine}/made_with", within=engines),
    shell:
        "brownpipe simulate {params.scene} --particles {wildcards.particles} --seeds {wildcards.first}-{wildcards.last}"
        " --engine {params.engine} {params.options} --allow-failed all --output {output:q} > {log:q} 2>&1"
