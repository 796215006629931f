"""Figure `thermodynamics`: pressure and collision rates against the packing fraction, and what theory expects."""

import numpy as np

from brownpipe import theory
from brownpipe.analysis.thermodynamics import DENSEST
from brownpipe.figures.cases import by_series, has
from brownpipe.figures.style import DASHED, INK, KINDS, PANEL, START, bars, grid, heads, tall_and_low
from brownpipe.figures.tables import long_table

Z, RATE, TRACER = "compressibility", "collision_rate", "tracer_collision_rate"
PANELS = {
    Z: ("$Z = P / nkT$", "compressibility from the virial"),
    RATE: ("collisions per disk and time", "collision rate of all disks"),
    TRACER: ("collisions per time", "collision rate of the tracer"),
}
ROOM = 1.1  # of a vertical axis, times the largest value
NEEDS = (RATE,)
LACKING = "there are no collision rates"


def chosen(cases):
    """Which of the cases that have what it needs are shown: every one."""
    return cases


def draw(cases):
    """One column per quantity: the cases against their packing fraction above, residuals in per cent below.

    The lower row is left out where theory expects nothing of any case.
    """
    names = [name for name in PANELS if any(has(case, name) for case in cases)]
    figure, axes = _panels(len(names), any(np.isfinite(_expected(case, name)) for case in cases for name in names))
    for name, (main, *low) in zip(names, axes.T, strict=True):
        mine = [case for case in cases if has(case, name)]
        _points(main, mine, name)
        compared = [case for case in mine if np.isfinite(_expected(case, name))]
        for panel in low:
            _residuals(panel, mine, name)
            panel.set_visible(bool(compared))
        alike = [case for case in compared if name == Z and has(case, "compressibility_rate")]
        if alike:
            _equations_of_state(main, *low, alike)
        main.set_xlim(0, 1.08 * max(float(case.packing_fraction) for case in mine))
        below = low[0] if compared else main
        below.set_xlabel("packing fraction $\\phi$")
        below.tick_params(labelbottom=True)
    heads(axes[0], [PANELS[name][1] for name in names])
    return figure


def _panels(columns, with_residuals):
    """A figure with one row of panels, or with a low one for the residuals below each."""
    if with_residuals:
        return tall_and_low(columns, ratio=2.0, sharey=False, height=5.6)
    return grid(1, columns, PANEL[0], 4.0)


def _series(cases):
    """Every scene: its words, how far aside its markers stand so that one does not hide the other, looks, cases."""
    widest = max(float(case.packing_fraction) for case in cases)
    for k, (scene, mine) in enumerate(by_series(cases).items()):
        colour, _, marker = KINDS[k % len(KINDS)]
        looks = {"fmt": marker, "color": colour, "markersize": 5, "markerfacecolor": "none", "elinewidth": 1.3}
        yield scene, 0.006 * k * widest, looks, mine


def _points(axes, cases, name):
    """The cases of each scene with their 95 % intervals."""
    for scene, aside, looks, mine in _series(cases):
        phi = [float(case.packing_fraction) + aside for case in mine]
        axes.errorbar(phi, [float(case[name]) for case in mine], bars(mine, name), label=scene, **looks)
    highest = np.nanmax([float(case[part]) for case in cases for part in (name, f"{name}_high")])
    axes.set_ylim(0, ROOM * highest or 1.0)
    axes.set_ylabel(PANELS[name][0])


def _residuals(axes, cases, name):
    """How far the cases of each scene are from theory."""
    for _, aside, looks, mine in _series(cases):
        compared = [case for case in mine if np.isfinite(_expected(case, name))]
        reference = np.array([_expected(case, name) for case in compared])
        residual = 100 * (np.array([float(case[name]) for case in compared]) / reference - 1)
        phi = [float(case.packing_fraction) + aside for case in compared]
        axes.errorbar(phi, residual, 100 * bars(compared, name) / reference, **looks)
    axes.axhline(0, color=START, linewidth=0.8)
    axes.set_ylabel("difference\nfrom theory, %")


def _expected(case, name):
    """What the case is compared with: Luding's Z for equal disks, else Enskog's theory if the dataset has it."""
    if name == Z and has(case, "compressibility_rate"):
        phi = float(case.packing_fraction)
        return theory.compressibility(phi, theory.contact_value(phi)) if phi <= DENSEST else np.nan
    return float(case[f"enskog_{name}"]) if has(case, f"enskog_{name}") else np.nan


def _equations_of_state(main, low, cases):
    """The curves of Luding and of Henderson for equal disks; residuals are from the former."""
    phi = np.linspace(0, min(DENSEST, 1.08 * max(float(case.packing_fraction) for case in cases)), 200)
    luding = theory.compressibility(phi, theory.contact_value(phi))
    henderson = theory.compressibility(phi, theory.contact_value_henderson(phi))
    main.plot(phi, luding, color=INK, linewidth=1, label="Luding (2001), equal disks")
    main.plot(phi, henderson, color=START, linestyle=DASHED, linewidth=1, label="Henderson (1975), equal disks")
    low.plot(phi, 100 * (henderson / luding - 1), color=START, linestyle=DASHED, linewidth=1)


def table(cases):
    """One row per case: what was measured, with its uncertainties, and what is expected."""
    extra = (Z, f"{Z}_rate", RATE, TRACER, "wall_pressure", "kinetic_temperature")
    references = (f"enskog_{name}" for name in PANELS)
    names = [name for name in (*extra, *references) if any(has(case, name) for case in cases)]
    return long_table(cases, (), ["packing_fraction", *names])
