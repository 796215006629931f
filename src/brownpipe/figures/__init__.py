"""The figures and the summary of a study, from its dataset alone.

One module per figure, each with `draw(cases)` and `table(cases)`; `style` has the one style of all, `cases` picks the
parts of the dataset. Bars and bands are 95 % intervals over runs. The same dataset gives the same bytes.
"""

import io
from pathlib import Path

from brownpipe.figures import displacement_distribution, health, msd, particle_counts
from brownpipe.figures.answer import summary, summary_table
from brownpipe.figures.cases import cases_of, has_msd, shown_particles
from brownpipe.figures.style import SAVE, drawing
from brownpipe.figures.tables import to_csv

__all__ = ["render", "summary"]


def render(dataset, folder, particles=None):
    """Write every figure of `dataset` as PNG, SVG and CSV, and `summary.csv`, into `folder`; return the paths.

    `msd` and `displacement_distribution` show one particle count: `particles`, or else the 2020 note's 150 if the study
    has it, or else the largest. `particle_counts` compares the counts and is left out if there is only one. `health`
    shows every run. Figures of the displacement are left out if no run with a tracer was kept.
    """
    from brownpipe.storage import write_file

    files = {"summary.csv": to_csv(summary_table(dataset))}
    with drawing():
        for figure, cases in _figures(dataset, particles):
            name, drawn = figure.__name__.rpartition(".")[2], figure.draw(cases)
            files |= {f"{name}.png": _image(drawn, "png"), f"{name}.svg": _image(drawn, "svg")}
            files[f"{name}.csv"] = to_csv(figure.table(cases))
    for name, contents in files.items():
        write_file(Path(folder) / name, contents)
    return [Path(folder) / name for name in files]


def _figures(dataset, particles):
    """Each figure that there is something to show in, with the cases it shows."""
    cases = cases_of(dataset)
    moving = [case for case in cases if has_msd(case)]
    shown = [case for case in moving if case.particles == shown_particles(dataset, particles)]
    if shown:
        yield msd, shown
        yield displacement_distribution, shown
    if len({int(case.particles) for case in moving}) > 1:
        yield particle_counts, moving
    yield health, cases


def _image(figure, kind):
    """The figure as the bytes of a PNG or SVG file, without date or version."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, **SAVE[kind])
    return buffer.getvalue()
