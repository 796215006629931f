rule simulate:
    output:
        f"{runs}.h5",
    log:
        f"{runs}.log",
    resources:
        **request["simulate"],
    params:
        scene=lookup(dpath="{digest}/scene", within=simulations),
        engine=lookup(dpath="{digest}/engine", within=simulations),
        digest=lookup(dpath="{digest}/digest", within=simulations),
        options=study.simulate_options,
    shell:
        "brownpipe simulate {params.scene} --particles {wildcards.particles} --seeds {wildcards.first}-{wildcards.last}"
        " --engine {params.engine} {params.options} --planned {params.digest} --allow-failed all --output {output:q}"
        " > {log:q} 2>&1"
