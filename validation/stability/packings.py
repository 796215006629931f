"""Packings nearly as dense as disks can be: gaps down to 1e-14 of a diameter, every disk caged by
its neighbours.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from brownpipe.engines.recording import HEALTH_BOUND
from brownpipe.figures.style import DOTTED, GREY, SERIES, grid
from validation.stability.game import PATH, pymunk
from validation.stability.outcome import Outcome
from validation.stability.programs import EVENT_DRIVEN, GAME
from validation.stability.start import packing
from validation.stability.table import Row, shown

CAGE = 20.0  # gaps: a disk that came further has passed through a neighbour or a wall
Found = dict[str, dict[float, Outcome]]  # program: gap: run


def measure(
    gaps: Sequence[float] = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14),
    crossings: float = 10_000.0,
    steps: int = 2000,
) -> Found:
    """Run each program for the time in which a disk at speed 1 crosses so many gaps.

    pymunk runs for so many steps, in each of which such a disk crosses a hundredth of a gap.
    """
    found: Found = {
        name: {g: run(packing(g), crossings * g) for g in gaps}
        for name, run in EVENT_DRIVEN.items()
    }
    games = {g: pymunk(packing(g), steps * PATH * g, PATH * g) for g in gaps}
    found[GAME] = {g: run for g, run in games.items() if run is not None}
    return found


def escaped(gap: float, run: Outcome) -> int:
    """Return the number of disks that are more than CAGE gaps away from where they began, or
    nowhere.
    """
    way = np.hypot(*(run.state.position - packing(gap).state.position).T)
    return int((~(way < CAGE * gap)).sum())


def rows(found: Found) -> list[Row]:
    """Return rows: collisions, worst overlap, relative energy drift, disks that left their
    cages.
    """
    made = []
    for gap, ours in found["brownpipe"].items():
        cells = [_cell(gap, found[name].get(gap)) for name in found]
        kept = not ours.failed and escaped(gap, ours) == 0
        promised = f"{shown(HEALTH_BOUND)}; 0 of 30 escape"
        made.append(Row(f"gap {shown(gap)}, {ours.events:,.0f} events", promised, cells, kept))
    return made


def _cell(gap: float, run: Outcome | None) -> str:
    if run is None:
        return "-"
    return f"{shown(run.worst_overlap, run.energy_drift)}; {escaped(gap, run)} escape"


def draw(found: Found) -> Figure:
    """Draw the worst overlap and the energy drift against the gap."""
    figure, (panels,) = grid(1, 2, 4.4, 3.5)
    for (name, runs), (colour, line, marker) in zip(found.items(), SERIES, strict=False):
        looks = {"color": colour, "linestyle": line, "marker": marker, "label": name}
        gaps = np.array(list(runs))
        panels[0].plot(gaps, [max(run.worst_overlap, 1e-17) for run in runs.values()], **looks)
        panels[1].plot(gaps, [max(abs(run.energy_drift), 1e-17) for run in runs.values()], **looks)
    for axes, label in zip(
        panels, ("worst overlap [diameters]", "energy drift (relative)"), strict=True
    ):
        axes.axhline(HEALTH_BOUND, color=GREY, linestyle=DOTTED, label="promised")
        axes.set(
            xscale="log", yscale="log", xlabel="gap [diameters]", ylabel=label, ylim=(1e-17, 10)
        )
    panels[0].plot(
        [*found["brownpipe"]],
        [*found["brownpipe"]],
        color=GREY,
        linewidth=0.8,
        label="the gap itself",
    )
    panels[1].legend(*panels[0].get_legend_handles_labels(), fontsize=7)
    return figure
