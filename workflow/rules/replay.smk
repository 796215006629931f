# One run of the study once more, with all disks and collisions, to be replayed in the page. It is bit-identical to the run
# of the same seed that the study has; `study/replay.py` says which studies have such a run.
rule replay:
    output:
        f"{results}/replay/{batch}.h5",
    log:
        f"{results}/logs/replay/{batch}.log",
    benchmark:
        f"{results}/benchmarks/replay/{batch}.tsv"
    resources:
        **request["replay"],
    params:
        scene=lookup(dpath="{scene}/{particles}/file", within=cases),
        physics=lookup(dpath="{scene}/{particles}/digest", within=cases),
        engine=lookup(dpath="{engine}/options", within=engines),
        made_with=lookup(dpath="{engine}/made_with", within=engines),
    shell:
        "brownpipe simulate {params.scene} --particles {wildcards.particles} --seeds {wildcards.first}-{wildcards.last}"
        " --engine {params.engine} --record all,events --allow-failed all --output {output:q} > {log:q} 2>&1"
