"""The figures and the summary of a study, from its dataset alone.

One module per figure, each with `draw(cases)` and `table(cases)`; `style` has the one style of all, `cases` picks the
parts of the dataset. Bars and bands are 95 % intervals over runs. The same dataset gives the same bytes.
"""

from pathlib import Path

from brownpipe.figures import displacement_distribution, health, msd, particle_counts, tradeoff
from brownpipe.figures.answer import summary, summary_table
from brownpipe.figures.cases import FigureError, cases_of, has_msd, one_count
from brownpipe.figures.style import drawing, image
from brownpipe.figures.tables import to_csv

__all__ = ["FigureError", "render", "summary", "tradeoff"]
MODULES = {
    module.__name__.rpartition(".")[2]: module for module in (msd, displacement_distribution, particle_counts, health)
}

KINDS = ("png", "svg", "csv")


def render(dataset, folder, names=None, particles=None):
    """Write figures of `dataset` as PNG, SVG and CSV, and `summary.csv`, into `folder`; return the paths.

    `names` says which figures; without it, all that there is something to show in. `msd` and
    `displacement_distribution` show one particle count of each scene: `particles`, or else the 2020 note's 150 if the
    scene has it, or else its largest. `particle_counts` compares the counts. `health` shows every run. Figures in the
    folder that are not drawn are removed, as they may be those of another dataset; the summary is written last.

    Raises FigureError for a figure of `names` that there is nothing to show in: the displacement if no run with a
    tracer was kept, particle counts if there is only one.
    """
    from brownpipe.storage import write_file

    shown = _cases_shown(dataset, particles)
    for name in names or ():
        if not shown[name]:
            raise FigureError(f"{name}: there is nothing to show in this figure: {_LACKING[name]}")
    files = {}
    with drawing():
        for name in names or [name for name, cases in shown.items() if cases]:
            figure, cases = MODULES[name], shown[name]
            drawn = figure.draw(cases)
            files |= {f"{name}.png": image(drawn, "png"), f"{name}.svg": image(drawn, "svg")}
            files[f"{name}.csv"] = to_csv(figure.table(cases))
    files["summary.csv"] = to_csv(summary_table(dataset))
    for old in (Path(folder) / f"{name}.{kind}" for name in MODULES for kind in KINDS):
        if old.name not in files:
            old.unlink(missing_ok=True)
    for name, contents in files.items():
        write_file(Path(folder) / name, contents)
    return [Path(folder) / name for name in files]


def _cases_shown(dataset, particles):
    """The cases that each figure shows; none if there is nothing to show."""
    cases = cases_of(dataset)
    moving = [case for case in cases if has_msd(case)]
    single = one_count(moving, particles)
    several = len({int(case.particles) for case in moving}) > 1
    return {
        "msd": single,
        "displacement_distribution": single,
        "particle_counts": moving if several else [],
        "health": cases,
    }


_LACKING = {
    "msd": "no run with a tracer was kept",
    "displacement_distribution": "no run with a tracer was kept",
    "particle_counts": "there are not two particle counts or more",
    "health": "there are no runs",
}
