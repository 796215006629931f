"""Pressure and bond-orientational order of hard disks about freezing, of few disks in a square
periodic box.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from xarray import Dataset

from brownpipe.figures.style import GREY, SERIES, grid
from validation.comparison import Comparison
from validation.result import Result

# Pressure P s^2/kT in the same square boxes by Monte Carlo, diameter s: by number of disks, for
# each packing fraction (pressure, standard error). B. Li et al., J. Chem. Phys. 157, 234111 (2022),
# data in their repository.
LI = {
    72: {
        0.680: (8.23631, 0.00034),
        0.684: (8.33421, 0.00043),
        0.688: (8.39654, 0.00040),
        0.692: (8.43819, 0.00041),
        0.696: (8.48214, 0.00059),
        0.700: (8.55170, 0.00059),
        0.704: (8.65810, 0.00058),
        0.708: (8.80381, 0.00045),
        0.712: (8.98256, 0.00053),
        0.716: (9.18825, 0.00083),
        0.720: (9.41867, 0.00050),
    },
    224: {
        0.680: (8.49105, 0.00019),
        0.684: (8.66582, 0.00024),
        0.688: (8.79579, 0.00026),
        0.692: (8.84651, 0.00055),
        0.696: (8.7966, 0.0011),
        0.700: (8.6876, 0.0012),
        0.704: (8.6262, 0.0021),
        0.708: (8.6305, 0.0044),
        0.712: (8.7378, 0.0053),
        0.716: (8.8869, 0.0073),
        0.720: (9.0844, 0.0099),
    },
    870: {
        0.680: (8.513249, 0.000027),
        0.684: (8.711343, 0.000068),
        0.688: (8.891164, 0.000034),
        0.690: (8.969898, 0.000075),
        0.692: (9.03666, 0.00011),
        0.696: (9.12212, 0.00016),
        0.700: (9.12966, 0.00015),
        0.704: (9.09681, 0.00035),
        0.708: (9.07174, 0.00036),
        0.710: (9.06469, 0.00043),
        0.712: (9.0541, 0.0013),
        0.716: (9.0272, 0.0049),
    },
    128**2: {
        0.698: (9.17405, 0.00049),
        0.704: (9.18558, 0.00080),
        0.708: (9.17630, 0.00074),
        0.712: (9.16554, 0.00090),
        0.716: (9.1587, 0.0010),
    },
}
REMARKS = {
    (224, 0.72): "the runs keep the orientation of the lattice that they start from, see above"
}


def compare(datasets: Mapping[str, Dataset]) -> list[Comparison]:
    """Return the comparisons of the pressures."""
    comparisons = []
    for n, phi, case in _cases(datasets["hexatic_order"]):
        quantity = f"$P s^2/kT$, $N = {n}$, $\\phi = {phi:.2f}$"
        published, error = LI[n][phi]
        comparison = Comparison(quantity, published, error, *_pressure(case), "Li et al. (2022)")
        comparisons.append(comparison._replace(remark=REMARKS.get((n, phi), "")))
    return comparisons


def _cases(data: Dataset) -> Iterator[tuple[int, float, Dataset]]:
    """Yield the number of disks, the packing fraction and the variables of each scene."""
    every = data.isel(engine=0).stack(case=("scene", "particles")).transpose("case", ...)
    measured = every.isel(case=np.flatnonzero(every.runs > 0))
    phi = measured.packing_fraction.values.round(4)
    for k in np.lexsort((phi, measured.particles.values)):
        yield int(measured.particles[k]), float(phi[k]), measured.isel(case=k)


def _pressure(case: Dataset) -> tuple[float, float]:
    """Return P s^2/kT and its standard error."""
    density = 4 * float(case.packing_fraction) / np.pi  # in units of 1/s^2
    return density * float(case.compressibility), density * float(
        case.compressibility_standard_error
    )


def draw(datasets: Mapping[str, Dataset], comparisons: Sequence[Comparison]) -> Figure:
    """Draw pressure and orientational order against the packing fraction."""
    cases = list(_cases(datasets["hexatic_order"]))
    figure, ((above,), (below,)) = grid(2, 1, 5.0, 2.7, sharex=True)
    for (n, published), (colour, line, marker) in zip(LI.items(), SERIES, strict=False):
        phi, pressure = np.array([(phi, value) for phi, (value, _) in published.items()]).T
        above.plot(
            phi,
            pressure,
            linestyle=line,
            color=colour if n < 1000 else GREY,
            label=f"$N = {n}$, Li et al.",
        )
        own = [(phi, case) for number, phi, case in cases if number == n]
        if not own:
            continue
        place, looks = [phi for phi, _ in own], {"fmt": marker, "color": colour, "markersize": 5}
        value, error = np.array([_pressure(case) for _, case in own]).T
        above.errorbar(place, value, 2 * error, **looks, label=f"$N = {n}$, brownpipe, 95 %")
        order, error = (
            [float(case[f"orientational_order_squared{part}"]) for _, case in own]
            for part in ("", "_standard_error")
        )
        below.errorbar(place, order, 2 * np.array(error), **looks)
    above.set_ylabel("$P s^2/kT$")
    below.set_ylabel("$\\langle|\\psi_6|^2\\rangle$")
    below.set_xlabel("packing fraction $\\phi$")
    below.legend(*above.get_legend_handles_labels(), fontsize=7, ncols=2, loc="upper left")
    return figure


RESULT = Result(
    "hexatic_order",
    ("hexatic_order",),
    compare,
    draw,
    # fails if the pressure is 3 % off
    {"hexatic_order": {"scenes": "scenes/freezing_72_short.yaml", "seeds": 12}},
)
