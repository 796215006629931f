"""Self-diffusion of equal hard disks: Enskog's theory, and boxes of several sizes before sound has
crossed them.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from xarray import DataArray, Dataset

from brownpipe.figures.style import GREY, SERIES, grid, log_axis
from validation.comparison import Comparison
from validation.result import Result
from validation.transport import Fluid, displacement, fixed_number, fluid

CROSSINGS = (
    0.2,
    0.5,
)  # times at which boxes of different sizes are compared, in units of the sound-crossing time
COLLISIONS = 10  # mean free times after which D(t) is compared with Enskog's theory


def compare(datasets: Mapping[str, Dataset]) -> list[Comparison]:
    """Return the comparisons: initial slopes, D(t) with Enskog's theory, box sizes with each
    other.
    """
    cases = {case.scene.item(): case for case in _cases(datasets["self_diffusion"])}
    dense = [case for case in cases.values() if case.particles == 1000]
    sizes = sorted(
        (case for name, case in cases.items() if "_030_" in name), key=lambda case: case.particles
    )
    rows = [_initial_slope(case) for case in dense] + [_enskog(case) for case in dense]
    return rows + [row for case in sizes[:-1] for row in _sizes(case, sizes[-1])]


def _cases(data: Dataset) -> Iterator[Dataset]:
    """Yield the dataset of each scene, at its own number of disks and its own sample times after t
    = 0.
    """
    for scene in data.scene:
        own = data.sel(scene=scene).isel(engine=0)
        case = own.isel(particles=int(np.flatnonzero(own.runs > 0)[0]))
        yield case.sel(time=(case.time > 0) & np.isfinite(case.msd))


def _fluid(case: Dataset) -> Fluid:
    return fluid(case.packing_fraction.item())


def _initial_slope(case: Dataset) -> Comparison:
    rate, error = case.collision_rate.item(), case.collision_rate_standard_error.item()
    slope = [-case.vacf_initial_slope.item() / 2, case.vacf_initial_slope_standard_error.item() / 2]
    name = f"$-C'(0)/\\Gamma$, {_at(case)}"
    return Comparison(name, 1.0, error / rate, slope[0] / rate, slope[1] / rate, "exact")


def _enskog(case: Dataset) -> Comparison:
    own = _fluid(case)
    t = case.time.values[np.searchsorted(case.time.values, COLLISIONS / own.rate)]
    name = f"$D(t)$, {_at(case)}, $\\Gamma t = {own.rate * t:.1f}$"
    d, error = _running(case.sel(time=t))
    return Comparison(
        name, own.diffusion, 0.0, d.item(), error.item(), "Enskog's theory", approximate=True
    )


def _sizes(small: Dataset, large: Dataset) -> Iterator[Comparison]:
    crossing = _fluid(small).crossing(small.particles.item())
    for share in CROSSINGS:
        t = small.time.values[
            np.searchsorted(small.time.values, share * crossing, side="right") - 1
        ]
        (theirs, their_error), (ours, error) = (
            _mean(case.sel(time=t, method="nearest")) for case in (large, small)
        )
        name = f"MSD$/4t$, {_at(small)}, $N = {small.particles.item()}$, $t = {t:.3g}$"
        source = f"brownpipe, $N = {large.particles.item()}$"
        yield Comparison(name, theirs.item(), their_error.item(), ours.item(), error.item(), source)


def _at(case: Dataset) -> str:
    return f"$\\phi = {case.packing_fraction.item():.4g}$"


def _running(case: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return D(t) = (1/4) d MSD/dt of infinitely many disks, and its standard error."""
    return _unbound(case, case.diffusion_running, 1.0), case.diffusion_running_standard_error.values


def _mean(case: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return MSD/4t at one time, the mean of D from 0 to t, of infinitely many disks, and its
    standard error.
    """
    phi, t = case.packing_fraction.item(), case.time.item()
    canonical = fixed_number(lambda x: displacement(x, t), phi, case.particles.item())
    return _unbound(case, case.msd_over_4t, 0.5) - canonical, case.msd_over_4t_standard_error.values


def _unbound(case: Dataset, d: DataArray, share: float) -> np.ndarray:
    """Add the motion of the centre of mass, which is at rest here: <V^2> = 2 kT/N m moves it by an
    MSD of 2 t^2/N.
    """
    return (d + share * case.time / case.particles).values


def draw(datasets: Mapping[str, Dataset], comparisons: Sequence[Comparison]) -> Figure:
    """Draw D(t) relative to Enskog's D, for several boxes and several densities, with the
    sound-crossing times.

    Points with the motion of the centre of mass, lines without.
    """
    cases = list(_cases(datasets["self_diffusion"]))
    figure, ((left, right),) = grid(1, 2, 4.6, 4.0)
    _panel(left, [case for case in cases if "_030_" in case.scene.item()], "N = {particles:,}")
    _panel(
        right, [case for case in cases if case.particles == 1000], "$\\phi$ = {phi:.2f}, N = 1,000"
    )
    left.set_title("$\\phi$ = 0.30")
    return figure


def _panel(axes: Axes, cases: list[Dataset], label: str) -> None:
    for case, (colour, _, marker) in zip(cases, SERIES, strict=False):
        own, particles = _fluid(case), case.particles.item()
        d, error = _running(case)
        text = label.format(particles=particles, phi=own.phi)
        points = own.rate * case.time, d / own.diffusion, 2 * error / own.diffusion
        axes.errorbar(*points, fmt=marker, color=colour, markersize=3.5, linewidth=1, label=text)
        axes.plot(
            own.rate * case.time,
            case.diffusion_running / own.diffusion,
            color=colour,
            linewidth=0.9,
        )
        axes.axvline(own.rate * own.crossing(particles), color=colour, linewidth=0.9, linestyle=":")
    axes.axhline(1, color=GREY, linewidth=1.2, label="Enskog")
    axes.set_xlabel("collisions per disk, $\\Gamma t$")
    axes.set_ylabel("$D(t)/D_E$")
    axes.set_ylim(0, 2)
    log_axis(axes, "x", 0.04, 120)
    axes.legend()


SMALL = {"scenes": ["scenes/diffusion_030_100.yaml", "scenes/diffusion_030_1000.yaml"], "seeds": 40}
RESULT = Result(
    "self_diffusion",
    ("self_diffusion",),
    compare,
    draw,
    {"self_diffusion": {"engines": "exact", **SMALL}},  # fails if the MSD is 8 % off
)
