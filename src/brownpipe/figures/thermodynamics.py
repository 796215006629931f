"""Figure `thermodynamics`: compressibility factor and collision rates against the packing fraction,
and theory.

Theory is Luding's equation of state for equal disks, and Enskog's for rates and mixtures
(docs/theory.md).
"""

from itertools import cycle

import numpy as np
from matplotlib import figure as matplotlib_figure
from matplotlib.axes import Axes
from xarray import Dataset

from brownpipe import theory
from brownpipe.analysis.thermodynamics import DENSEST
from brownpipe.figures.cases import has, quantities_of, series_of, title_of
from brownpipe.figures.figure import Columns, Figure
from brownpipe.figures.looks import Looks
from brownpipe.figures.style import (
    DASHED,
    GREY,
    INK,
    MARKS,
    points,
    put_titles_and_legends,
    stacked_panels,
)

Z = "compressibility"
RATE = "collision_rate"
TRACER = "tracer_collision_rate"
PANELS = {
    Z: ("$Z = 1 + W / 2NkTt$", "compressibility factor from the pair virial $W$"),
    RATE: ("collisions per disk and unit time", "collision rate of all disks"),
    TRACER: ("collisions per unit time", "collision rate of the tracer"),
}
RATES = (RATE, f"{RATE}_at_temperature", TRACER, f"{TRACER}_at_temperature")
MEASURED = (Z, f"{Z}_rate", f"wall_{Z}", *RATES, "wall_pressure", "kinetic_temperature")


def draw_thermodynamics(cases: list[Dataset]) -> matplotlib_figure.Figure:
    """Draw one column per quantity: its values against the packing fraction above, deviations from
    theory below.

    The lower row is left out if there is no theory for any of the cases.
    """
    names = quantities_of(PANELS, cases)
    with_theory = any(np.isfinite(_expected(case, name)) for case in cases for name in names)
    legend = 0.19 * max(0, len(_series(cases)) - 2)  # room for many series [inch]
    heights = (3.73, 1.87) if with_theory else (4.0,)
    shares = [height * (1 + legend / sum(heights)) for height in heights]
    labels = ("", "deviation\nfrom theory (%)")[: len(heights)]
    figure, axes = stacked_panels(labels, len(names), shares, sharey=False)
    for name, (main, *low) in zip(names, axes.T, strict=True):
        measured = [case for case in cases if has(case, name)]
        for (label, series_cases), mark in zip(
            _series(measured).items(), cycle(MARKS), strict=False
        ):
            densities = [float(case.packing_fraction) for case in series_cases]
            looks: Looks = {**mark, "label": label}
            points(main, densities, series_cases, name, **looks)
            for panel in low:
                deviations = [_deviation(case, name) for case in series_cases]
                points(panel, densities, deviations, name, **mark)
        main.margins(x=0.15, y=0.12)
        if name == Z:
            main.axhline(1, color=GREY, linewidth=0.8)  # of the ideal gas
        else:
            main.set_ylim(bottom=0)
        main.set(xlim=np.maximum(main.get_xlim(), 0), ylabel=PANELS[name][0])
        for panel in low:
            panel.sharex(main)
            main.tick_params(labelbottom=False)
            panel.axhline(0, color=GREY, linewidth=0.8)
            panel.margins(y=0.15)
        if (
            name == Z
            and with_theory
            and any(has(case, "compressibility_rate") for case in measured)
        ):  # equal disks
            _equations_of_state(main, low[0], main.get_xlim())
        main.locator_params(axis="x", nbins=5)
        (low[0] if low else main).set_xlabel("packing fraction $\\phi$")
    put_titles_and_legends(axes[0], [PANELS[name][1] for name in names])
    return figure


def _series(cases: list[Dataset]) -> dict[str, list[Dataset]]:
    """The cases by all but their density, under a name also if there is one series."""
    series = series_of(cases, "packing_fraction", "particles", drift=True)
    return {label or title_of(*group): group for label, group in series.items()}


def _deviation(case: Dataset, name: str) -> Dataset:
    """The deviation from theory [%]: of a rate, of that at the temperature of the scene if there is
    one.
    """
    compared = f"{name}_at_temperature" if has(case, f"{name}_at_temperature") else name
    deviations = {}
    for suffix in ("", "_low", "_high"):
        value = case[f"{compared}{suffix}"]
        deviations[f"{name}{suffix}"] = 100 * (value / _expected(case, name) - 1)
    return Dataset(deviations)


def _expected(case: Dataset, name: str) -> float:
    """Enskog's value, of Z of equal disks Luding's; NaN if the dataset has none."""
    return float(case.get(f"enskog_{name}", np.nan))


def _equations_of_state(main: Axes, low: Axes, ends: tuple[float, float]) -> None:
    """Draw Luding's and Henderson's equations of state for equal disks, and the deviation of the
    latter.
    """
    phi = np.linspace(max(0.0, ends[0]), min(DENSEST, ends[1]), 200)
    luding = theory.compressibility(phi, theory.contact_value(phi))
    henderson = theory.compressibility(phi, theory.contact_value_henderson(phi))
    main.plot(phi, luding, color=INK, linewidth=1, label="Luding (2001), equal disks")
    main.plot(
        phi,
        henderson,
        color=GREY,
        linestyle=DASHED,
        linewidth=1,
        label="Henderson (1975), equal disks",
    )
    low.plot(phi, 100 * (henderson / luding - 1), color=GREY, linestyle=DASHED, linewidth=1)


FIGURE = Figure(
    draw=draw_thermodynamics,
    variables=(RATE,),
    every_count=True,
    table=Columns((), ("packing_fraction", *MEASURED, *(f"enskog_{name}" for name in PANELS))),
)
