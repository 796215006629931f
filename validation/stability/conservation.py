"""Energy, momentum and overlaps against the number of events, for extreme masses and radii."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from brownpipe.engines.recording import HEALTH_BOUND
from brownpipe.figures.style import DOTTED, GREY, SERIES, grid, shades
from validation.stability.game import MOST_STEPS, pymunk, time_step
from validation.stability.outcome import Outcome
from validation.stability.programs import EVENT_DRIVEN, GAME, OTHERS
from validation.stability.start import Start, gas
from validation.stability.table import Row, count, shown

SCENES = {  # half side of the box; number, radius and mass of each species, at kT = 1
    "equal disks": (1.0, [(10, 0.1, 1.0)]),
    "masses 1 : 7.3": (1.0, [(5, 0.1, 1.0), (5, 0.1, 7.3)]),
    "masses 1 : 1e3": (1.0, [(5, 0.1, 1.0), (5, 0.1, 1e3)]),
    "masses 1 : 1e6": (1.0, [(9, 0.1, 1.0), (1, 0.1, 1e6)]),
    "masses 1 : 1e12": (1.0, [(9, 0.1, 1.0), (1, 0.1, 1e12)]),
    "radii 1 : 10": (1.0, [(9, 0.05, 1.0), (1, 0.5, 1.0)]),
    "radii 1 : 100": (1.0, [(9, 0.005, 1.0), (1, 0.5, 1.0)]),
    "radii 1 : 1e3": (1.0, [(9, 0.0005, 1.0), (1, 0.5, 1.0)]),
}
LONG = {"equal disks": (1e8,), "masses 1 : 1e12": (1e8,), "radii 1 : 1e3": (1e8,)}
COMPARED = 1e6  # events of the runs in the table
Found = dict[tuple[str, str], dict[float, Outcome]]  # scene and program: about how many events: run


def measure(
    events: Sequence[float] = (1e4, 1e5, 1e6, 1e7),
    others: Sequence[float] = (1e4, 1e5, 1e6),
    long: Mapping[str, Sequence[float]] | None = None,
    scenes: Sequence[str] = tuple(SCENES),
    steps: int = MOST_STEPS,
) -> Found:
    """Run every scene for about so many events; `long`: further numbers of events of single scenes,
    brownpipe alone.
    """
    runs: Found = {}
    long = LONG if long is None else long
    for name in scenes:
        start = gas(*SCENES[name])
        rate = _rate(start)
        wanted = (*events, *long.get(name, ()))
        runs[name, "brownpipe"] = {n: EVENT_DRIVEN["brownpipe"](start, n / rate) for n in wanted}
        for program, run in OTHERS.items():
            runs[name, program] = {n: run(start, n / rate) for n in others}
        game = pymunk(start, steps * time_step(start))
        if game is not None:
            runs[name, GAME] = {float(game.events): game}
    return runs


def _rate(start: Start, duration: float = 200.0) -> float:
    return EVENT_DRIVEN["brownpipe"](start, duration).events / duration


def rows(found: Found) -> list[Row]:
    """Return rows: relative energy drift, momentum residual, worst overlap."""
    made = []
    for name in dict.fromkeys(scene for scene, _ in found):
        ours = found[name, "brownpipe"]
        for n, run in ours.items():
            if n < COMPARED and n != max(ours):
                continue
            cells = [_cell(found.get((name, program), {}).get(n)) for program in EVENT_DRIVEN]
            game = found.get((name, GAME), {}) if n == COMPARED else {}
            cells.append(
                "; ".join(f"{_cell(one)} ({k:,.0f} events)" for k, one in game.items()) or "-"
            )
            kept = not run.failed and max(map(abs, run[3:6])) <= HEALTH_BOUND
            made.append(Row(f"{name}, {count(n)} events", shown(HEALTH_BOUND), cells, kept))
    return made


def _cell(run: Outcome | None) -> str:
    return "-" if run is None else shown(run.energy_drift, run.momentum_residual, run.worst_overlap)


def draw(found: Found) -> Figure:
    """Draw the energy drift and the worst overlap against the number of events."""
    figure, (panels,) = grid(1, 2, 4.4, 3.5)
    names = dict.fromkeys(scene for scene, _ in found)
    looks = dict(zip((*OTHERS, GAME), SERIES[1:], strict=False))
    labels = {
        "energy_drift": "energy drift (relative)",
        "worst_overlap": "worst overlap [contact distances]",
    }
    for axes, (field, label) in zip(panels, labels.items(), strict=True):
        for name, colour in zip(names, shades(len(names)), strict=True):
            _line(axes, found[name, "brownpipe"], field, color=colour, marker="o", label=name)
        for program, (colour, line, marker) in looks.items():
            drawn = [found[name, program] for name in names if (name, program) in found]
            for k, runs in enumerate(drawn):
                _line(
                    axes,
                    runs,
                    field,
                    color=colour,
                    linestyle=line,
                    marker=marker,
                    linewidth=0.8,
                    alpha=0.6,
                    label=f"{program}, the same scenes" if k == 0 else None,
                )
        axes.axhline(HEALTH_BOUND, color=GREY, linestyle=DOTTED, label="promised")
        axes.set(xscale="log", yscale="log", xlabel="events", ylabel=label, ylim=(1e-17, 10))
    panels[0].legend(fontsize=6.5, loc="upper left", ncols=2)
    return figure


def _line(axes, runs: Mapping[float, Outcome], field: str, **looks) -> None:  # type: ignore[no-untyped-def]
    sizes = np.maximum(np.abs([getattr(run, field) for run in runs.values()]), 1e-17)
    axes.plot([run.events for run in runs.values()], sizes, markersize=3, **looks)
