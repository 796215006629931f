rule figures:
    input:
        dataset=f"{results}/aggregate/{study.name}.nc",
        replay=replay,
    output:
        summary=report(f"{results}/figures/summary.txt", caption="../report/summary.rst", category="Answer"),
        numbers=f"{results}/figures/summary.csv",
        provenance=f"{results}/figures/provenance.json",
        figures=[
            report(f"{results}/figures/{name}.svg", caption=f"{captions}/{name}.rst", category="Figures")
            for name in study.figures
        ],
        others=expand("{results}/figures/{name}.{kind}", results=results, name=study.figures, kind=["png", "csv"]),
        checksums=f"{results}/figures/SHA256SUMS",
        page=f"{results}/report.html",
    log:
        f"{results}/logs/figures/{study.name}.log",
    benchmark:
        f"{results}/benchmarks/figures/{study.name}.tsv"
    threads: 2
    resources:
        **request["figures"],
    params:
        names=study.figures,
        replay=["--replay", *replay] if replay else [],
        made_with=made_with("figures"),
    shell:
        'brownpipe figures {input.dataset:q} --output "$(dirname {output.summary:q})" --page {output.page:q}'
        " {params.replay:q} --figures {params.names:q} --cores {threads} 2> {log:q}"
