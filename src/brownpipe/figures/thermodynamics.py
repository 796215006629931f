"""Figure `thermodynamics`: pressure and collision rates against the packing fraction, and what theory expects."""

import numpy as np

from brownpipe import theory
from brownpipe.figures.cases import by_series, has
from brownpipe.figures.style import DASHED, INK, KINDS, START, bars, head, tall_and_low
from brownpipe.figures.tables import long_table

Z, RATE, TRACER = "compressibility", "collision_rate", "tracer_collision_rate"
PANELS = {
    Z: ("$Z = P / nkT$", "compressibility from the virial"),
    RATE: ("collisions per disk and time", "collision rate of all disks"),
    TRACER: ("collisions per time", "collision rate of the tracer"),
}
NEEDS = (RATE,)
LACKING = "there are no collision rates"


def chosen(cases):
    """Which of the cases that have what it needs are shown: every one."""
    return cases


def draw(cases):
    """One column per quantity: the cases against their packing fraction above, residuals in per cent below."""
    names = [name for name in PANELS if any(has(case, name) for case in cases)]
    figure, axes = tall_and_low(len(names), ratio=2.0, sharey=False, height=5.6)
    for name, (main, low) in zip(names, axes.T, strict=True):
        mine = [case for case in cases if has(case, name)]
        _points(main, low, mine, name)
        if name == Z and any(has(case, "compressibility_rate") for case in mine):
            _equations_of_state(main, low, mine)
        main.set_ylabel(PANELS[name][0])
        main.set_ylim(bottom=0)
        head(main, PANELS[name][1])
        below = low if np.isfinite([_expected(case, name) for case in mine]).any() else main
        below.set_xlabel("packing fraction $\\phi$")
        below.tick_params(labelbottom=True)
        low.set_visible(below is low)
        low.set_ylabel("difference\nfrom theory, %")
    return figure


def _points(main, low, cases, name):
    """The cases of each scene with their 95 % intervals, and how far they are from theory."""
    widest = max(float(case.packing_fraction) for case in cases)
    for k, (scene, mine) in enumerate(by_series(cases).items()):
        colour, _, marker = KINDS[k % len(KINDS)]
        aside = 0.006 * k * widest  # one marker does not hide the other
        phi = [float(case.packing_fraction) + aside for case in mine]
        looks = {"fmt": marker, "color": colour, "markersize": 5, "markerfacecolor": "none", "elinewidth": 1.3}
        main.errorbar(phi, [float(case[name]) for case in mine], bars(mine, name), label=scene, **looks)
        compared = [case for case in mine if np.isfinite(_expected(case, name))]
        reference = np.array([_expected(case, name) for case in compared])
        residual = 100 * (np.array([float(case[name]) for case in compared]) / reference - 1)
        phi = [float(case.packing_fraction) + aside for case in compared]
        low.errorbar(phi, residual, 100 * bars(compared, name) / reference, **looks)
    low.axhline(0, color=START, linewidth=0.8)


def _expected(case, name):
    """What the case is compared with: Luding's Z for equal disks, else Enskog's theory if the dataset has it."""
    if name == Z and has(case, "compressibility_rate"):
        phi = float(case.packing_fraction)
        return theory.compressibility(phi, theory.contact_value(phi))
    return float(case[f"enskog_{name}"]) if has(case, f"enskog_{name}") else np.nan


def _equations_of_state(main, low, cases):
    """The curves of Luding and of Henderson for equal disks; residuals are from the former."""
    phi = np.linspace(0, 1.08 * max(float(case.packing_fraction) for case in cases), 200)
    luding = theory.compressibility(phi, theory.contact_value(phi))
    henderson = theory.compressibility(phi, theory.contact_value_henderson(phi))
    main.plot(phi, luding, color=INK, linewidth=1, label="Luding (2001), equal disks")
    main.plot(phi, henderson, color=START, linestyle=DASHED, linewidth=1, label="Henderson (1975), equal disks")
    low.plot(phi, 100 * (henderson / luding - 1), color=START, linestyle=DASHED, linewidth=1)
    main.set_xlim(0, phi[-1])


def table(cases):
    """One row per case: what was measured, with its uncertainties, and what is expected."""
    extra = (Z, f"{Z}_rate", RATE, TRACER, "wall_pressure", "kinetic_temperature")
    references = (f"enskog_{name}" for name in PANELS)
    names = [name for name in (*extra, *references) if any(has(case, name) for case in cases)]
    return long_table(cases, (), ["packing_fraction", *names])
