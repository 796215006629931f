# This rule measures CPU times, so no other job may run at the same time.
rule tradeoff:
    input:
        ancient(compared),
        plan=ancient(plan_file),
    output:
        dataset=f"{results}/tradeoff/{study.name}.nc",
        made_from=f"{results}/tradeoff/made_from_{made_from['tradeoff']}.txt",
    log:
        f"{results}/logs/tradeoff.log",
    threads: 1000  # limited to all cores
    resources:
        **resources_of_jobs["tradeoff"],
    params:
        study=exactly(study_words),
        any_digest=any_digest,
        planned=made_from["tradeoff"],
    shell:
        'rm -f "$(dirname {output.dataset:q})"/made_from_{params.any_digest}.txt'
        " && brownpipe tradeoff {params.study} --plan {input.plan:q} --output {output.dataset:q}"
        " --planned {params.planned} --list-runs {output.made_from:q} > {log:q} 2>&1"


rule tradeoff_drawings:
    input:
        ancient(trajectories),
        ancient(str(rules.tradeoff.output.made_from)),
        dataset=ancient(str(rules.tradeoff.output.dataset)),
    output:
        summary=report(
            f"{results}/tradeoff/summary.txt",
            caption=f"{captions}/tradeoff.rst",
            category="Trade-off",
        ),
        numbers=f"{results}/tradeoff/summary.csv",
        provenance=update(f"{results}/tradeoff/provenance.json"),  # lists the files of the drawing before
        figure=report(
            f"{results}/tradeoff/tradeoff.svg",
            caption=f"{captions}/tradeoff.rst",
            category="Trade-off",
        ),
        others=[f"{results}/tradeoff/tradeoff.{kind}" for kind in ("png", "csv")],
        page=f"{results}/tradeoff/report.html",
        drawn_from=f"{results}/tradeoff/drawn_from_{made_from['tradeoff_figures']}.txt",
    log:
        f"{results}/logs/tradeoff_drawings.log",
    resources:
        **resources_of_jobs["tradeoff_drawings"],
    params:
        any_digest=any_digest,
        planned=made_from["tradeoff"],
    shell:
        'rm -f "$(dirname {output.summary:q})"/drawn_from_{params.any_digest}.txt'
        ' && brownpipe figures {input.dataset:q} --output "$(dirname {output.summary:q})" --page {output.page:q}'
        " --planned {params.planned} > {log:q} 2>&1"
        " && sha256sum {input.dataset:q} {output.summary:q} {output.numbers:q} {output.provenance:q} {output.figure:q}"
        " {output.others:q} {output.page:q} > {output.drawn_from:q}"


# As rule all does for the study, this asks for every file of the trade-off, and shows its answer at each run.
rule tradeoff_figures:
    input:
        rules.tradeoff_drawings.output,
        rules.tradeoff.output,
        trajectories,
        summary=rules.tradeoff_drawings.output.summary,
        page=rules.tradeoff_drawings.output.page,
        drawn_from=rules.tradeoff_drawings.output.drawn_from,
    localrule: True
    params:
        not_as_made=not_as_made,
    shell:
        "sha256sum --check --quiet {input.drawn_from:q} >&2 || {{ {params.not_as_made}; }}"
        " && cat {input.summary:q} && echo all on one page: {input.page:q}"
