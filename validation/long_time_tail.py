"""The long-time tail of the velocity autocorrelation of equal hard disks, against mode-coupling
theory.

C(t) = <v(0).v(t)>/(2 kT/m). With zero total momentum and N disks it lacks the motion of the centre
of mass, 1/N; with this added it is that of infinitely many disks, until sound has crossed the box.
S runs, T sample times.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from xarray import Dataset

from brownpipe.figures.style import DATA, DOTTED, FIT, GREY, MODEL, grid, log_axis
from validation.comparison import Comparison
from validation.result import Result
from validation.transport import Fluid, fluid

STARTS = {
    0.14: 20,
    0.30: 30,
    0.45: 40,
    0.60: 40,
}  # mean free times from which Erpenbeck and Wood compare with theory
CROSSED = 0.7  # the window ends at this share of the sound-crossing time, or with the run
BINS_PER_DECADE = 8  # of time, in the figure


class Tail(NamedTuple):
    """C(t) of all runs of a scene."""

    particles: int
    fluid: Fluid
    t: np.ndarray  # (T,) sample times after 0
    c: np.ndarray  # (S, T) C(t) of infinitely many disks
    at_start: np.ndarray  # (S,) C(0)

    @property
    def crossing(self) -> float:
        """Time that sound takes across the box."""
        return self.fluid.crossing(self.particles)

    @property
    def start(self) -> float:
        """Start of the window in which the tail is compared with theory."""
        return STARTS[round(self.fluid.phi, 2)] / self.fluid.rate

    @property
    def end(self) -> float:
        """End of this window."""
        return min(CROSSED * self.crossing, self.t[-1])

    def amplitudes(self, start: float, end: float) -> np.ndarray:
        """Return t C(t) (S,) of every run in a window: a of a/t, least squares with equal
        weights.
        """
        inside = _inside(self.t, start, end)
        return (self.c[:, inside] / self.t[inside]).sum(axis=1) / (self.t[inside] ** -2).sum()

    def exponent(self) -> tuple[float, float]:
        """Return -d ln C/d ln t in the window and its standard error.

        Least squares of a/t - b ln(t/t0)/t, the first two terms of a t0^x/t^(1 + x) for a small x =
        b/a. Both a and b are linear in C, so that every run has its own, and their covariance over
        runs gives the error.
        """
        inside = _inside(self.t, self.start, self.end)
        t = self.t[inside]
        terms = np.stack([1 / t, -np.log(t / np.sqrt(self.start * self.end)) / t])
        a, b = np.linalg.solve(terms @ terms.T, terms @ self.c[:, inside].T)
        x = b.mean() / a.mean()
        return 1 + x, _error((b - x * a) / a.mean())


def tail_of(runs: Dataset, phi: float) -> Tail:
    """Return the tail of a scene from the arrays (S, T) of its runs and its packing fraction."""
    c = runs.velocity_autocorrelation.values / 2 + 1 / runs.particles
    return Tail(runs.particles, fluid(phi), runs.time.values[1:], c[:, 1:], c[:, 0])


def _inside(t: np.ndarray, start: float, end: float) -> np.ndarray:
    return (t >= start * (1 - 1e-9)) & (t <= end * (1 + 1e-9))


def _error(values: np.ndarray) -> float:
    """Return the standard error of the mean over runs."""
    return values.std(ddof=1) / np.sqrt(len(values))


def compare(datasets: Mapping[str, Dataset]) -> list[Comparison]:
    """Return the comparisons: C(0); amplitude and exponent of the tail; 100,000 disks with
    10,000.
    """
    tails = _tails(datasets)
    smallest = min(tail.particles for tail in tails)
    usual = [tail for tail in tails if tail.particles == smallest]
    rows = [
        _start(max(usual, key=lambda tail: len(tail.c)))
    ]  # other densities begin with the same velocities
    rows += [row(tail) for row in (_amplitude, _exponent) for tail in usual]
    return rows + [
        _larger(tail, other)
        for tail in tails
        if tail not in usual
        for other in usual
        if _same(tail, other)
    ]


def _tails(datasets: Mapping[str, Dataset]) -> list[Tail]:
    data = datasets["long_time_tail"]
    runs = {name: datasets[f"long_time_tail/{name}"] for name in data.scene.values}
    return [
        tail_of(each, data.packing_fraction.sel(scene=name).max().item())
        for name, each in runs.items()
    ]


def _same(tail: Tail, other: Tail) -> bool:
    return bool(np.isclose(tail.fluid.phi, other.fluid.phi))


def _start(tail: Tail) -> Comparison:
    name = f"$C(0)$, $\\phi = {tail.fluid.phi:.4g}$"
    return Comparison(name, 1.0, 0.0, tail.at_start.mean(), _error(tail.at_start), "exact")


def _amplitude(tail: Tail) -> Comparison:
    a = tail.amplitudes(tail.start, tail.end)
    source = "Ernst et al. (1970), Gass (1971)"
    return Comparison(
        f"$t\\,C(t)$, {_window(tail)}",
        tail.fluid.tail,
        0.0,
        a.mean(),
        _error(a),
        source,
        approximate=True,
    )


def _exponent(tail: Tail) -> Comparison:
    name = f"$-d \\ln C/d \\ln t$, {_window(tail)}"
    return Comparison(name, 1.0, 0.0, *tail.exponent(), "Ernst et al. (1970)", approximate=True)


def _window(tail: Tail) -> str:
    return f"$\\phi = {tail.fluid.phi:.4g}$, $t = {tail.start:.3g}$ to ${tail.end:.3g}$"


def _larger(tail: Tail, usual: Tail) -> Comparison:
    ours, theirs = (each.amplitudes(usual.start, usual.end) for each in (tail, usual))
    name = f"$t\\,C(t)$, {_window(usual)}, $N = {tail.particles:,}$"
    source = f"brownpipe, $N = {usual.particles:,}$"
    return Comparison(name, theirs.mean(), _error(theirs), ours.mean(), _error(ours), source)


def draw(datasets: Mapping[str, Dataset], comparisons: Sequence[Comparison]) -> Figure:
    """Draw t C(t) against t for each density, with the law of mode-coupling theory and the
    sound-crossing time.
    """
    tails = _tails(datasets)
    densities = sorted({round(tail.fluid.phi, 4) for tail in tails})
    figure, panels = grid(-(-len(densities) // 2), 2, 3.8, 2.8)
    for axes, phi in zip(panels.flat, densities, strict=False):
        _panel(axes, [tail for tail in tails if np.isclose(tail.fluid.phi, phi, atol=1e-4)])
        axes.set_title(f"$\\phi$ = {phi:.2f}")
    panels.flat[0].legend(fontsize=8)
    return figure


def _panel(axes: Axes, tails: list[Tail]) -> None:
    own, t = tails[0].fluid, tails[0].t
    for tail, (colour, marker) in zip(tails, ((DATA, "o"), (FIT, "s")), strict=False):
        middle, mean, error = _binned(tail)
        label = f"N = {tail.particles:,}"
        axes.errorbar(
            middle,
            mean,
            2 * error,
            fmt=marker,
            color=colour,
            markersize=3.5,
            linewidth=1,
            label=label,
        )
        axes.axvline(tail.crossing, color=colour, linewidth=0.9, linestyle=DOTTED)
    last = max(tail.t[-1] for tail in tails)
    line = np.geomspace(t[0], last)
    axes.axhline(own.tail, color=GREY, linewidth=1.2, label="mode coupling")
    axes.plot(
        line,
        own.tail - 1 / (4 * np.pi * own.density * own.sound**2 * line),
        color=MODEL,
        label="with sound",
    )
    axes.set_xlabel("time $t$")
    axes.set_ylabel("$t\\,C(t)$")
    axes.set_ylim(0, 2.2 * own.tail)
    log_axis(axes, "x", t[0], 1.4 * max(last, tails[0].crossing))


def _binned(tail: Tail) -> np.ndarray:
    """Return (3, bins): mean time, t C(t) and its standard error in bins of time."""
    label = np.round(np.log10(tail.t) * BINS_PER_DECADE)
    bins = [tail.t[label == k] for k in np.unique(label)]
    amplitudes = [tail.amplitudes(times[0], times[-1]) for times in bins]
    values = [
        (np.exp(np.log(times).mean()), a.mean(), _error(a))
        for times, a in zip(bins, amplitudes, strict=True)
    ]
    return np.array(values).T


RESULT = Result(
    "long_time_tail",
    ("long_time_tail",),
    compare,
    draw,
    # fails if C(0) is 1 % off
    {"long_time_tail": {"engines": "exact", "scenes": "scenes/tail_030.yaml", "seeds": 4}},
    of_single_runs=True,
)
