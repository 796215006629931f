"""Speeds from 1e-170 to 1e160: the same disks in other units, by powers of two, must do the same to
the bit.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from brownpipe.figures.style import SERIES, grid
from validation.stability.game import pymunk
from validation.stability.outcome import Outcome
from validation.stability.programs import EVENT_DRIVEN, GAME, Attempt
from validation.stability.start import gas
from validation.stability.table import Row

PROGRAMS: dict[str, Attempt] = {**EVENT_DRIVEN, GAME: pymunk}
Found = dict[
    str, dict[int, tuple[int, bool]]
]  # program: exponent of the unit of time: events, same bits as with 0


def measure(
    powers: Sequence[int] = (-531, -515, -332, 0, 332, 480, 515, 565), duration: float = 4.0
) -> Found:
    """Run with units of time of 2^-power, which makes speeds of 2^-power."""
    start = gas(1.0, [(8, 0.1, 1.0), (8, 0.14, 0.3)])
    found: Found = {}
    for name, run in PROGRAMS.items():
        plainly = run(start, duration)
        if plainly is None:
            continue
        found[name] = {}
        for power in powers:
            scaled = run(start.scaled(0, power), float(np.ldexp(duration, power)))
            if scaled is not None:
                found[name][power] = _compared(scaled, plainly, power)
    return found


def _compared(run: Outcome, plainly: Outcome, power: int) -> tuple[int, bool]:
    same = np.array_equal(run.state.position, plainly.state.position)
    same &= np.array_equal(np.ldexp(run.state.velocity, power), plainly.state.velocity)
    return run.events, bool(same)


def rows(found: Found) -> list[Row]:
    """Return rows: events of each program, and whether the run has the same bits."""
    made = []
    for power in found["brownpipe"]:
        if power == 0:
            continue
        cells = [
            _cell(found[name][power], found[name][0]) if name in found else "-" for name in PROGRAMS
        ]
        speed = f"$10^{{{-power * np.log10(2):.0f}}}$"
        made.append(Row(f"speeds of {speed}", "same bits", cells, found["brownpipe"][power][1]))
    return made


def _cell(run: tuple[int, bool], plainly: tuple[int, bool]) -> str:
    return "same bits" if run[1] else f"{run[0]} of {plainly[0]} collisions"


def draw(found: Found) -> Figure:
    """Draw the share of collisions that are found against the speed."""
    figure, ((axes,),) = grid(1, 1, 6.0, 3.4)
    for (name, runs), (colour, line, marker) in zip(found.items(), SERIES, strict=False):
        powers = sorted(runs)
        share = [runs[k][0] / runs[0][0] for k in powers]
        axes.plot(
            [-k * np.log10(2) for k in powers],
            share,
            color=colour,
            linestyle=line,
            marker=marker,
            label=name,
        )
    axes.set(xlabel="$\\log_{10}$ of the speeds", ylabel="collisions, relative to\nspeeds of 1")
    axes.legend()
    return figure
