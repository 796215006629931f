"""Time reversal in the note's scene: velocities flipped after T, back after another T to where all
began.

Errors grow as exp(lambda t). Pairs of runs that begin 1e-15 apart measure lambda, the largest
Lyapunov exponent.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from brownpipe.engines.exact.simulation import simulate
from brownpipe.figures.style import DASHED, FIT, GREY, SERIES, grid
from validation.page import value
from validation.stability.game import pymunk
from validation.stability.programs import EVENT_DRIVEN, GAME, Attempt
from validation.stability.start import Start, notes_scene
from validation.stability.table import Row, shown

PROMISED = {0.1: 1e-12, 0.5: 1e-8}  # T: distance; tests/test_exact.py
APART = 1e-15  # of the two runs of a pair, at the beginning
LINEAR = (
    0.3,
    1.1,
)  # times between which separations grow exponentially: above round-off, far below a radius
SAMPLING = 0.02  # of the separations [time]


class Reversals(NamedTuple):
    """Distances from the start and separations, [length]."""

    times: tuple[float, ...]  # T
    distance: dict[
        str, np.ndarray
    ]  # program: (seeds, times), the largest of any disk; NaN: not run
    separation: np.ndarray  # (pairs, samples) of pairs of runs, root of the sum over disks
    exponents: np.ndarray  # (pairs,) lambda [1/time]

    @property
    def exponent(self) -> tuple[float, float]:
        """Lambda with its standard error."""
        return float(self.exponents.mean()), float(
            self.exponents.std(ddof=1) / np.sqrt(len(self.exponents))
        )


def measure(
    times: Sequence[float] = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0),
    seeds: int = 6,
    pairs: int = 100,
    games: Sequence[float] = (0.1, 0.3, 0.5),
) -> Reversals:
    """Measure both; `games`: the T of pymunk, one seed."""
    starts = [notes_scene(seed) for seed in range(1, seeds + 1)]
    distance = {
        name: np.array([[there_and_back(run, start, t) for t in times] for start in starts])
        for name, run in EVENT_DRIVEN.items()
    }
    distance[GAME] = np.array(
        [[there_and_back(pymunk, starts[0], t) if t in games else np.nan for t in times]]
    )
    separation = np.array([_separation(notes_scene(seed)) for seed in range(pairs)])
    return Reversals(
        tuple(times), distance, separation, np.array([_exponent(each) for each in separation])
    )


def there_and_back(run: Attempt, start: Start, duration: float) -> float:
    """Return how far the disk is from its start that is furthest from it; NaN if the program is not
    there.
    """
    there = run(start, duration)
    if there is None:
        return np.nan
    reversed_state = there.state._replace(velocity=-there.state.velocity)
    back = run(start._replace(state=reversed_state), duration)
    if back is None:
        return np.nan
    return float(np.abs(back.state.position - start.state.position).max())


def _separation(start: Start, duration: float = 1.7) -> np.ndarray:
    """Return the separation of two runs of brownpipe at every sample time."""
    position = start.state.position
    nudged = position + APART * np.random.default_rng(0).standard_normal(position.shape)
    runs = [
        simulate(each.scene(duration, sample_interval=SAMPLING), [0], {"all"}).whole[0].position
        for each in (start, start._replace(state=start.state._replace(position=nudged)))
    ]
    return np.sqrt(np.sum((runs[0] - runs[1]) ** 2, axis=(1, 2)))


def _exponent(separation: np.ndarray) -> float:
    """Return lambda of a pair, from its separations at both ends of LINEAR."""
    first, last = (round(end / SAMPLING) for end in LINEAR)
    return float(np.log(separation[last] / separation[first]) / (SAMPLING * (last - first)))


def rows(found: Reversals) -> list[Row]:
    """Return rows: median and largest distance over seeds; the Lyapunov exponent."""
    made = []
    for k, t in enumerate(found.times):
        bound = PROMISED.get(t)
        kept = bound is None or found.distance["brownpipe"][:, k].max() <= bound
        cells = [_cell(distance[:, k]) for distance in found.distance.values()]
        made.append(Row(f"$T = {t:g}$", shown(bound) if bound else "-", cells, bool(kept)))
    return [*made, Row("$\\lambda$ [1/time]", "-", [value(*found.exponent), "-", "-", "-"])]


def _cell(values: np.ndarray) -> str:
    if np.isnan(values).all():
        return "-"
    return (
        shown(values[0])
        if len(values) == 1
        else f"{shown(np.median(values))}, at most {shown(values.max())}"
    )


def draw(found: Reversals) -> Figure:
    """Draw distances against T, and separations against time."""
    figure, ((left, right),) = grid(1, 2, 4.4, 3.5)
    for (name, distance), (colour, line, marker) in zip(
        found.distance.items(), SERIES, strict=False
    ):
        seen = ~np.isnan(distance).all(axis=0)
        if seen.any():
            middle = np.median(distance[:, seen], axis=0)
            left.plot(
                np.array(found.times)[seen],
                middle,
                color=colour,
                linestyle=line,
                marker=marker,
                label=name,
            )
    for t, bound in PROMISED.items():
        left.plot(
            [t],
            [bound],
            color=GREY,
            marker="v",
            linestyle="",
            label="promised" if t == 0.1 else None,
        )
    left.set(
        yscale="log", xlabel="time $T$ of the reversal", ylabel="distance from the start [length]"
    )
    left.legend()
    time = SAMPLING * np.arange(found.separation.shape[1])
    right.plot(time, found.separation[:20].T, color=GREY, linewidth=0.4, alpha=0.5)
    right.plot(
        time,
        np.median(found.separation, axis=0),
        color=SERIES[0][0],
        label=f"median of {len(found.separation)}",
    )
    exponent, error = found.exponent
    middle = len(time) // 2
    guide = np.median(found.separation[:, middle]) * np.exp(exponent * (time - time[middle]))
    right.plot(
        time,
        guide,
        color=FIT,
        linestyle=DASHED,
        label=f"$\\exp(\\lambda t)$, $\\lambda = {exponent:.2f} \\pm {error:.2f}$",
    )
    right.set(
        yscale="log", xlabel="time $t$", ylabel="separation of two runs [length]", ylim=(1e-16, 30)
    )
    right.legend()
    return figure
