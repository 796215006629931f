# This rule measures CPU times, so no other job may run at the same time.
rule tradeoff:
    input:
        trajectories,
    output:
        f"{results}/tradeoff/{study.name}.nc",
    log:
        f"{results}/logs/tradeoff/{study.name}.log",
    benchmark:
        f"{results}/benchmarks/tradeoff/{study.name}.tsv"
    threads: 1000  # limited to all cores
    resources:
        **request["tradeoff"],
    params:
        study=(shell_path(study_file),),
        config=settings,
        instead_of=study.instead_of,
        made_with=made_with("tradeoff"),
    shell:
        "brownpipe tradeoff {params.study} {params.config:q} --output {output:q} 2> {log:q}"


rule tradeoff_drawings:
    input:
        f"{results}/tradeoff/{study.name}.nc",
    output:
        table=report(f"{results}/tradeoff/tradeoff.txt", caption=f"{captions}/tradeoff.rst", category="Trade-off"),
        numbers=f"{results}/tradeoff/tradeoff.csv",
        provenance=f"{results}/tradeoff/provenance.json",
        figures=[
            report(f"{results}/tradeoff/tradeoff_{name}.svg", caption=f"{captions}/tradeoff.rst", category="Trade-off")
            for name in study.tradeoff_cases
        ],
        others=expand("{results}/tradeoff/tradeoff_{name}.png", results=results, name=study.tradeoff_cases),
        checksums=f"{results}/tradeoff/SHA256SUMS",
        page=f"{results}/tradeoff/report.html",
    log:
        f"{results}/logs/tradeoff_drawings/{study.name}.log",
    benchmark:
        f"{results}/benchmarks/tradeoff_drawings/{study.name}.tsv"
    resources:
        **request["tradeoff_drawings"],
    params:
        made_with=made_with("tradeoff_figures"),
    shell:
        'brownpipe figures {input:q} --output "$(dirname {output.table:q})" --page {output.page:q} 2> {log:q}'


# As rule all does for the study, this asks for every file of the trade-off, and shows its answer at each run.
rule tradeoff_figures:
    input:
        rules.tradeoff_drawings.output,
        rules.tradeoff.output,
        rules.tradeoff.input,
        table=rules.tradeoff_drawings.output.table,
        page=rules.tradeoff_drawings.output.page,
    localrule: True
    shell:
        "cat {input.table:q} && echo all on one page: {input.page:q}"
