"""The figures and the summary of a study, from its dataset alone.

One module per figure, each with `draw(cases)` and `table(cases)`; `style` has the one style of all, `cases` picks the
parts of the dataset. Bars and bands are 95 % intervals over runs. The same dataset gives the same bytes.
"""

from pathlib import Path

from brownpipe.errors import FigureError
from brownpipe.figures import (
    diffusion,
    displacement_distribution,
    energy,
    health,
    msd,
    pair_distribution,
    particle_counts,
    thermodynamics,
    tradeoff,
    velocity_autocorrelation,
    velocity_distribution,
)
from brownpipe.figures.cases import cases_of, check_count, has, one_count
from brownpipe.figures.style import drawing, image_bytes
from brownpipe.figures.summary import summary, summary_table
from brownpipe.figures.tables import to_csv
from brownpipe.storage import write_file

__all__ = ["FigureError", "render", "summary", "tradeoff"]
MODULES = {
    module.__name__.rpartition(".")[2]: module
    for module in (
        msd,
        displacement_distribution,
        diffusion,
        velocity_autocorrelation,
        velocity_distribution,
        pair_distribution,
        energy,
        thermodynamics,
        particle_counts,
        health,
    )
}
KINDS = ("png", "svg", "csv")


def render(dataset, folder, names=None, particles=None):
    """Write figures of `dataset` as PNG, SVG and CSV, and `summary.csv`, into `folder`; return the paths.

    `names` says which figures; without it, all that there is something to show in. Most show one particle count of
    each scene: `particles`, or else the 2020 note's 150 if the scene has it, or else its largest. `particle_counts`
    and `thermodynamics` compare the counts. `health` shows every run. Figures in the folder that are not drawn are
    removed, as they may be those of another dataset; the summary is written last.

    Raises FigureError for a figure of `names` that there is nothing to show in: the displacement if no run with a
    tracer was kept, particle counts if there is only one, and so on.
    """
    shown = _cases_shown(dataset, particles)
    for name in names or ():
        if not shown[name]:
            raise FigureError(f"{name}: there is nothing to show in this figure: {MODULES[name].LACKING}")
    files = {}
    with drawing():
        for name in names or [name for name, cases in shown.items() if cases]:
            figure, cases = MODULES[name], shown[name]
            drawn = figure.draw(cases)
            files |= {f"{name}.{kind}": image_bytes(drawn, kind) for kind in ("png", "svg")}
            files[f"{name}.csv"] = to_csv(figure.table(cases))
    files["summary.csv"] = to_csv(summary_table(dataset))
    for old in (Path(folder) / f"{name}.{kind}" for name in MODULES for kind in KINDS):
        if old.name not in files:
            old.unlink(missing_ok=True)
    for name, contents in files.items():
        write_file(Path(folder) / name, contents)
    return [Path(folder) / name for name in files]


def _cases_shown(dataset, particles):
    """The cases that each figure shows: those with something to show, of every particle count or of one."""
    cases = cases_of(dataset)
    check_count(cases, particles)
    shown = {}
    for name, figure in MODULES.items():
        having = [case for case in cases if has(case, *figure.NEEDS)]
        shown[name] = figure.chosen(having) if hasattr(figure, "chosen") else one_count(having, particles)
    return shown
