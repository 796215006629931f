"""A clock at 1e9 time units, and a box 1e6 away from the origin."""

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from brownpipe.engines.recording import HEALTH_BOUND
from brownpipe.figures.style import DOTTED, GREY, SERIES, grid
from validation.stability.game import pymunk, time_step
from validation.stability.outcome import Outcome
from validation.stability.programs import COLUMNS, EVENT_DRIVEN, GAME
from validation.stability.start import Start, gas, listed
from validation.stability.table import Row, shown

LONE = (0.1, -0.2, 0.9 / 64, 0.7 / 64, 0.25, 1.0)  # x, y, vx, vy, radius, mass; in [-3, 3]^2
LONE_BOUND = 1e-5  # tests/test_extremes.py
THIN = (1000.0, [(5, 0.5, 1.0)])  # half side of the box; number, radius and mass of the disks
SHIFT = 2.0**20  # of the box in x and y, exact in all coordinates
FAR_BOUND = 1.2e-10  # half the spacing of coordinates there


class Clocks(NamedTuple):
    """By program: errors of a lone disk by duration, outcomes of a thin gas by duration, and what a
    far box changes.
    """

    lone: dict[str, dict[float, float]]  # distance from the exact place [length]; NaN: not run
    gas: dict[str, dict[float, Outcome]]
    far: dict[
        str, tuple[float, float, float]
    ]  # largest change of a position, of a velocity; worst overlap


def measure(durations: Sequence[float] = (1e5, 1e6, 1e7, 1e8, 1e9), near: float = 1.0) -> Clocks:
    """Measure all three. The gas: 5 disks of radius 0.5 at kT = 1 in a box of side 2000; far: for
    the time `near`.
    """
    lone, thin = listed(3.0, [LONE]), gas(*THIN)
    errors, outcomes, far = {}, {}, {}
    close = _rounded(gas(2.0, [(20, 0.14, 1.0), (20, 0.1, 0.3)]))
    for name, run in EVENT_DRIVEN.items():
        errors[name] = {t: _error(run(lone, t), t) for t in durations}
        outcomes[name] = {t: run(thin, t) for t in durations}
        far[name] = _change(run(close, near), run(close.moved(SHIFT), near))
    here = pymunk(close, near)
    there = pymunk(close.moved(SHIFT), near)
    if here is not None and there is not None:
        far[GAME] = _change(here, there)
    return Clocks(errors, outcomes, far)


def _error(run: Outcome, duration: float) -> float:
    """Return how far a lone disk is from where it should be."""
    exact = [_reflected(LONE[axis], LONE[2 + axis], duration, Fraction(11, 4)) for axis in range(2)]
    return float(np.abs(run.state.position[0] - exact).max())


def _reflected(x: float, v: float, t: float, half: Fraction) -> float:
    """Return where a point is at time t that bounces between -half and half, in exact
    arithmetic.
    """
    way = (Fraction(x) + Fraction(v) * Fraction(t) + half) % (4 * half)
    return float((way if way <= 2 * half else 4 * half - way) - half)


def _rounded(start: Start) -> Start:
    """Return the start with coordinates that stay exact when the box is moved by SHIFT."""
    return start._replace(
        state=start.state._replace(position=np.round(start.state.position * 2**30) / 2**30)
    )


def _change(here: Outcome, there: Outcome) -> tuple[float, float, float]:
    place = np.abs(there.state.position - SHIFT - here.state.position).max()
    return (
        float(place),
        float(np.abs(there.state.velocity - here.state.velocity).max()),
        there.worst_overlap,
    )


def rows(found: Clocks) -> list[Row]:
    """Return the rows of the table."""
    longest = max(found.lone["brownpipe"])
    steps = [
        f"not run: {shown(longest / time_step(start))} steps"
        for start in (listed(3.0, [LONE]), gas(*THIN))
    ]
    alone = Row(
        f"a lone disk, $t = {_power(longest)}$: distance from the exact place",
        shown(LONE_BOUND),
        [*(shown(found.lone[name][longest]) for name in EVENT_DRIVEN), steps[0]],
        found.lone["brownpipe"][longest] <= LONE_BOUND,
    )
    ends = [found.gas[name][longest] for name in EVENT_DRIVEN]
    thin = Row(
        f"5 disks, $t = {_power(longest)}$, {ends[0].pair_collisions:,} pair collisions: worst "
        "overlap, energy drift",
        shown(HEALTH_BOUND),
        [*(shown(end.worst_overlap, end.energy_drift) for end in ends), steps[1]],
        not ends[0].failed,
    )
    place, velocity, _ = found.far["brownpipe"]
    far = Row(
        f"a box {SHIFT:,.0f} away: change of a position, of a velocity; worst overlap",
        f"{FAR_BOUND:.1e}, 0; {shown(HEALTH_BOUND)}",
        [_far_cell(found.far.get(name)) for name in COLUMNS],
        place <= FAR_BOUND and velocity == 0,
    )
    return [alone, thin, far]


def _power(value: float) -> str:
    return f"10^{{{round(np.log10(value))}}}"


def _far_cell(found: tuple[float, float, float] | None) -> str:
    return "-" if found is None else f"{shown(*found[:2])}; {shown(found[2])}"


def draw(found: Clocks) -> Figure:
    """Draw the error of the lone disk and the worst overlap of the gas against the duration."""
    figure, (panels,) = grid(1, 2, 4.4, 3.5)
    for name, (colour, line, marker) in zip(EVENT_DRIVEN, SERIES, strict=False):
        looks = {"color": colour, "linestyle": line, "marker": marker, "label": name}
        panels[0].plot(
            list(found.lone[name]),
            [max(error, 1e-17) for error in found.lone[name].values()],
            **looks,
        )
        seen = {t: run.worst_overlap for t, run in found.gas[name].items() if run.worst_overlap > 0}
        panels[1].plot(list(seen), list(seen.values()), **looks)
    labels = ("a lone disk: error of its position [length]", "5 disks: worst overlap [diameters]")
    for axes, bound, label in zip(panels, (LONE_BOUND, HEALTH_BOUND), labels, strict=True):
        axes.axhline(bound, color=GREY, linestyle=DOTTED, label="promised")
        axes.set(xscale="log", yscale="log", xlabel="duration $t$", ylabel=label)
    panels[1].legend(
        *panels[0].get_legend_handles_labels(), loc="center", bbox_to_anchor=(0.5, 0.36)
    )
    return figure
