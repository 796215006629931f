rule figures:
    input:
        ancient(trajectories),
        ancient(str(rules.aggregate.output.made_from)),
        dataset=ancient(str(rules.aggregate.output.dataset)),
    output:
        summary=report(
            f"{results}/figures/summary.txt", caption="../report/summary.rst", category="Answer"
        ),
        numbers=f"{results}/figures/summary.csv",
        provenance=update(f"{results}/figures/provenance.json"),  # lists the files of the drawing before
        figures=[
            report(
                f"{results}/figures/{name}.svg",
                caption=f"{captions}/{name}.rst",
                category="Figures",
            )
            for name in study.figures
        ],
        others=expand(
            "{results}/figures/{name}.{kind}",
            results=results,
            name=study.figures,
            kind=["png", "csv"],
        ),
        page=f"{results}/report.html",
        drawn_from=f"{results}/figures/drawn_from_{made_from['figures']}.txt",
    log:
        f"{results}/logs/figures.log",
    threads: 2
    resources:
        **resources_of_jobs["figures"],
    params:
        options=exactly(figure_options(study)),
        any_digest=any_digest,
        planned=made_from["aggregate"],
    shell:
        'rm -f "$(dirname {output.summary:q})"/drawn_from_{params.any_digest}.txt'
        ' && brownpipe figures {input.dataset:q} --output "$(dirname {output.summary:q})" --page {output.page:q}'
        " {params.options:q} --planned {params.planned} --cores {threads} > {log:q} 2>&1"
        " && sha256sum {input.dataset:q} {output.summary:q} {output.numbers:q} {output.provenance:q} {output.figures:q}"
        " {output.others:q} {output.page:q} > {output.drawn_from:q}"
