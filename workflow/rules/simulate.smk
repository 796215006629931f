# The scene file is no input but a parameter, and so is the digest of its physics: editing a comment runs nothing again.
rule simulate:
    output:
        f"{results}/simulate/{{scene}}/N{{particles}}/{{engine}}/{{first}}-{{last}}.h5",
    log:
        f"{results}/logs/simulate/{{scene}}/N{{particles}}/{{engine}}/{{first}}-{{last}}.log",
    benchmark:
        f"{results}/benchmarks/simulate/{{scene}}/N{{particles}}/{{engine}}/{{first}}-{{last}}.tsv"
    params:
        scene=lookup(dpath="{scene}/{particles}/file", within=cases),
        physics=lookup(dpath="{scene}/{particles}/digest", within=cases),
        measuring=study.measuring,
        made_with=made_with("simulate"),
    shell:
        "brownpipe simulate {params.scene:q} --particles {wildcards.particles} --seeds {wildcards.first}-{wildcards.last}"
        " --engine {wildcards.engine} {params.measuring} --output {output} 2> {log}"
