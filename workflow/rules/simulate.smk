rule simulate:
    output:
        f"{results}/simulate/{{scene}}/N{{particles}}/{{engine}}/{{first}}-{{last}}.h5",
    params:
        file=lookup(dpath="{scene}/{particles}/file", within=cases),
        physics=lookup(dpath="{scene}/{particles}/digest", within=cases),
        source=source_digest(),
    log:
        f"{results}/logs/simulate/{{scene}}/N{{particles}}/{{engine}}/{{first}}-{{last}}.log",
    benchmark:
        f"{results}/benchmarks/simulate/{{scene}}/N{{particles}}/{{engine}}/{{first}}-{{last}}.tsv"
    shell:
        "brownpipe simulate {params.file} --particles {wildcards.particles} --seeds {wildcards.first}-{wildcards.last}"
        " --engine {wildcards.engine} --output {output} 2> {log}"
