"""Figure `thermodynamics`: pressure and collision rates against the packing fraction, and what theory expects."""

import numpy as np

from brownpipe import theory
from brownpipe.analysis.thermodynamics import DENSEST
from brownpipe.figures.cases import by_series, has
from brownpipe.figures.style import DASHED, INK, KINDS, PANEL, START, apart, bars, grid, heads, tall_and_low
from brownpipe.figures.tables import long_table

Z, RATE, TRACER = "compressibility", "collision_rate", "tracer_collision_rate"
PANELS = {
    Z: ("$Z = 1 + W / 2NkTt$", "compressibility from the pair virial $W$"),
    RATE: ("collisions per disk and time", "collision rate of all disks"),
    TRACER: ("collisions per time", "collision rate of the tracer"),
}
ROOM = 0.12  # beyond the data, of their range; 0.1 of the value where they have none
MARKER = 0.022  # least distance of two markers, of the horizontal axis
LOOKS = [(KINDS[k % 4][0], KINDS[(k + k // 4) % 4][2]) for k in range(16)]  # of scenes: colour and marker
VARIABLES = (RATE,)
LACKING = "there are no collision rates"


def draw(cases):
    """One column per quantity: the cases against their packing fraction above, residuals in per cent below.

    The lower row is left out where theory expects nothing of any case.
    """
    names = [name for name in PANELS if any(has(case, name) for case in cases)]
    compared = any(np.isfinite(_expected(case, name)) for case in cases for name in names)
    figure, axes = _panels(len(names), compared, len(by_series(cases)))
    for name, (main, *low) in zip(names, axes.T, strict=True):
        mine = [case for case in cases if has(case, name)]
        ends = _horizontal(mine)
        phi = [float(case.packing_fraction) for case in mine]
        place = apart(phi, min(MARKER, 0.5 / len(phi)) * (ends[1] - ends[0]), *ends)
        series = list(_series(mine, place))
        _points(main, series, name)
        compared = [case for case in mine if np.isfinite(_expected(case, name))]
        for panel in low:
            _residuals(panel, series, name)
            panel.set_visible(bool(compared))
        alike = [case for case in compared if name == Z and has(case, "compressibility_rate")]
        if alike:
            _equations_of_state(main, *low, ends)
        main.set_xlim(*ends)
        main.locator_params(axis="x", nbins=5)
        below = low[0] if compared else main
        moved = not np.allclose(place, phi, rtol=1e-9)
        below.set_xlabel("packing fraction $\\phi$" + (" (markers set apart)" if moved else ""))
        below.tick_params(labelbottom=True)
    heads(axes[0], [PANELS[name][1] for name in names])
    return figure


def _panels(columns, with_residuals, series):
    """A figure with one row of panels, or with a low one for the residuals below each; higher with a long legend."""
    legend = 0.19 * max(0, series - 2)
    if with_residuals:
        return tall_and_low(columns, ratio=2.0, sharey=False, height=5.6 + legend)
    return grid(1, columns, PANEL[0], 4.0 + legend)


def _horizontal(cases):
    """Ends of the axis of packing fractions: from 0 if they spread widely, else around them."""
    phi = [float(case.packing_fraction) for case in cases]
    room = max(0.15 * (max(phi) - min(phi)), 0.08 * max(phi))
    return (0.0 if 2 * min(phi) < max(phi) else min(phi) - room), max(phi) + room


def _series(cases, places):
    """Every scene: its words, its looks, its cases and where their markers stand."""
    at = {id(case): place for case, place in zip(cases, places, strict=True)}
    for k, (scene, mine) in enumerate(by_series(cases).items()):
        colour, marker = LOOKS[k % len(LOOKS)]
        looks = {"fmt": marker, "color": colour, "markersize": 5, "markerfacecolor": "none", "elinewidth": 1.3}
        yield scene, looks, mine, [at[id(case)] for case in mine]


def _points(axes, series, name):
    """The cases of each scene with their 95 % intervals."""
    values = [1.0] if name == Z else []
    for scene, looks, mine, phi in series:
        axes.errorbar(phi, [float(case[name]) for case in mine], bars(mine, name), label=scene, **looks)
        values += [float(case[part]) for case in mine for part in (name, f"{name}_low", f"{name}_high")]
        values += [_expected(case, name) for case in mine]
    low, high = np.nanmin(values), np.nanmax(values)
    room = max(ROOM * (high - low), 0.1 * abs(high) if name != Z else 0.02) or 1.0
    axes.set_ylim(0 if name != Z and 0 <= 2 * low < high else low - room, high + room)
    axes.set_ylabel(PANELS[name][0])


def _residuals(axes, series, name):
    """How far the cases of each scene are from theory: rates at the temperature of the scene, as theory has them."""
    for _, looks, mine, phi in series:
        known = np.array([np.isfinite(_expected(case, name)) for case in mine])
        cases = [case for case, compared in zip(mine, known, strict=True) if compared]
        reference = np.array([_expected(case, name) for case in cases])
        shown = [_at_temperature(case, name) for case in cases]
        value = np.array([float(case[one]) for case, one in zip(cases, shown, strict=True)])
        reach = np.reshape([bars([case], one)[:, 0] for case, one in zip(cases, shown, strict=True)], (-1, 2)).T
        axes.errorbar(np.array(phi)[known], 100 * (value / reference - 1), 100 * reach / reference, **looks)
    axes.axhline(0, color=START, linewidth=0.8)
    axes.margins(y=0.15)
    axes.set_ylabel("difference\nfrom theory, %")


def _at_temperature(case, name):
    """The variable that is compared with theory: of a rate, the one at the temperature of the scene if there is one."""
    return f"{name}_at_temperature" if has(case, f"{name}_at_temperature") else name


def _expected(case, name):
    """What the case is compared with: Luding's Z for equal disks, else Enskog's theory if the dataset has it."""
    if name == Z and has(case, "compressibility_rate"):
        phi = float(case.packing_fraction)
        return theory.compressibility(phi, theory.contact_value(phi)) if phi <= DENSEST else np.nan
    return float(case[f"enskog_{name}"]) if has(case, f"enskog_{name}") else np.nan


def _equations_of_state(main, low, ends):
    """The curves of Luding and of Henderson for equal disks; residuals are from the former."""
    phi = np.linspace(max(0.0, ends[0]), min(DENSEST, ends[1]), 200)
    luding = theory.compressibility(phi, theory.contact_value(phi))
    henderson = theory.compressibility(phi, theory.contact_value_henderson(phi))
    main.plot(phi, luding, color=INK, linewidth=1, label="Luding (2001), equal disks")
    main.plot(phi, henderson, color=START, linestyle=DASHED, linewidth=1, label="Henderson (1975), equal disks")
    low.plot(phi, 100 * (henderson / luding - 1), color=START, linestyle=DASHED, linewidth=1)


def table(cases):
    """One row per case: what was measured, with its uncertainties, and what is expected."""
    rates = (one for name in (RATE, TRACER) for one in (name, f"{name}_at_temperature"))
    extra = (Z, f"{Z}_rate", f"wall_{Z}", *rates, "wall_pressure", "kinetic_temperature")
    references = (f"enskog_{name}" for name in PANELS)
    names = [name for name in (*extra, *references) if any(has(case, name) for case in cases)]
    return long_table(cases, (), ["packing_fraction", *names])
