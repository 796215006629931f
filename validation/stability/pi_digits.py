"""The digits of pi from collisions: Galperin (2003).

A disk of mass 100^k comes to a light one at rest before a wall. The number of all collisions is the
integer part of 10^k pi: 3, 31, 314, ...
"""

import math

from matplotlib.figure import Figure

from brownpipe.engines.recording import HEALTH_BOUND
from brownpipe.figures.style import DOTTED, GREY, SERIES, grid
from validation.stability.game import pymunk
from validation.stability.outcome import Outcome
from validation.stability.programs import EVENT_DRIVEN, GAME
from validation.stability.start import Start, listed
from validation.stability.table import Row, shown

DURATION = 30.0  # after which both disks fly away; the far wall is not reached
PATH = 0.05  # of the light disk at its largest speed in a step of pymunk, in radii
Found = dict[str, dict[int, Outcome]]  # program: k: run


def start(k: int) -> Start:
    """Return the two disks; the wall at x = -20."""
    return listed(20.0, [(-18.0, 0, 0, 0, 0.5, 1.0), (-16.0, 0, -1, 0, 0.5, 100.0**k)])


def measure(digits: int = 7, games: int = 2) -> Found:
    """Count collisions for k = 0 to `digits`, by pymunk to `games`."""
    found: Found = {
        name: {k: run(start(k), DURATION) for k in range(digits + 1)}
        for name, run in EVENT_DRIVEN.items()
    }
    runs = {k: pymunk(start(k), DURATION, PATH * 0.5 / 10**k, 10**6) for k in range(games + 1)}
    found[GAME] = {k: run for k, run in runs.items() if run is not None}
    return found


def rows(found: Found) -> list[Row]:
    """Return rows: collisions, and the relative energy drift."""
    made = []
    for k, ours in found["brownpipe"].items():
        promised = math.floor(10**k * math.pi)
        cells = [_cell(found[name].get(k)) for name in found]
        kept = ours.events == promised and not ours.failed
        made.append(Row(f"$k = {k}$", f"{promised}; {shown(HEALTH_BOUND)}", cells, kept))
    return made


def _cell(run: Outcome | None) -> str:
    return "-" if run is None else f"{run.events}; {shown(run.energy_drift)}"


def draw(found: Found) -> Figure:
    """Draw the error of the count and the energy drift against k."""
    figure, (panels,) = grid(1, 2, 4.4, 3.5)
    for (name, runs), (colour, line, marker) in zip(found.items(), SERIES, strict=False):
        looks = {"color": colour, "linestyle": line, "marker": marker, "label": name}
        panels[0].plot(
            list(runs),
            [run.events - math.floor(10**k * math.pi) for k, run in runs.items()],
            **looks,
        )
        panels[1].plot(
            list(runs), [max(abs(run.energy_drift), 1e-17) for run in runs.values()], **looks
        )
    panels[0].set(xlabel="$k$, mass ratio $100^k$", ylabel="collisions too many")
    panels[0].set_yscale("symlog", linthresh=1)
    panels[1].axhline(HEALTH_BOUND, color=GREY, linestyle=DOTTED, label="promised")
    panels[1].set(xlabel="$k$, mass ratio $100^k$", ylabel="energy drift (relative)", yscale="log")
    panels[1].legend()
    return figure
