rule figures:
    input:
        f"{results}/aggregate/{study.name}.nc",
    output:
        f"{results}/figures/summary.txt",
    log:
        f"{results}/logs/figures/{study.name}.log",
    benchmark:
        f"{results}/benchmarks/figures/{study.name}.tsv"
    shell:
        "brownpipe figures {input} --output $(dirname {output}) 2> {log}"
