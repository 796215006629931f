"""Figure `pair_distribution`: g(r) of every pair of species, and its value at contact by two
routes.

The routes: extrapolation of g(r) to contact, and the collision rate of the pair (docs/theory.md).
"""

from functools import partial
from typing import Unpack

import numpy as np
from matplotlib.axes import Axes
from xarray import DataArray, Dataset

from brownpipe import theory
from brownpipe.analysis.pairs import NORMAL
from brownpipe.figures import style
from brownpipe.figures.cases import estimate_of, has
from brownpipe.figures.figure import Columns, Figure
from brownpipe.figures.looks import Looks
from brownpipe.observables.pairs import BINS_PER_CONTACT

NAME = "pair_distribution"
# Label, colour, marker
CONTACTS = {
    "contact_value": ("at contact, by extrapolation", style.FIT, "o"),
    "contact_value_rate": ("at contact, from the collision rate", style.MODEL, "s"),
}
LARGEST_ERROR = 0.02  # relative error of g(r) above which neighbouring bins are pooled
# Bins in a pooled one: a tenth of the smallest contact distance in the scene. g(r) of large disks
# among small ones has structure of the size of the small ones, too (depletion).
MOST_POOLED = BINS_PER_CONTACT // 10
DILUTE = 0.2  # packing fraction below which the first order in the density is drawn


def draw_pair_distributions(axes: Axes, cases: list[Dataset], **looks: Unpack[Looks]) -> None:
    """Draw g(r) of each pair of species with its 95 % band, and theory.

    Of several pairs or with `looks` it is drawn with its value at contact, of a single one with
    both values.
    """
    pairs = []
    for pair in cases:
        is_apart = pair.distance.values > float(pair.contact_distance)
        pairs.append(pair.isel(distance=is_apart))
    contacts = [float(pair.contact_distance) for pair in pairs]
    axes.axhline(1, color=style.GREY, linewidth=0.8)
    for contact in {*contacts}:
        axes.axvline(contact, color=style.GREY, linestyle=style.DOTTED, linewidth=1)
    single = len(pairs) == 1 and not looks
    for pair, line in style.styled_cases(pairs, partial(_in_words, single), looks):
        style.band(axes, _pooled(pair, _bins_pooled(pair)), NAME, **line)
        for name in (name for name in CONTACTS if has(pair, name)):
            words, colour, marker = CONTACTS[name]
            label = f"{words}: {estimate_of(pair, name)}" if single else "_"
            style.points(
                axes,
                [float(pair.contact_distance)],
                [pair],
                name,
                color=colour if single else line["color"],
                marker=marker,
                label=label,
            )
    _theory(axes, pairs, named=not looks)
    end = max(float(pair.distance[-1]) for pair in pairs)
    axes.set_xlim(min(contacts) - 0.04 * (end - min(contacts)), end)
    axes.set_xlabel("centre-to-centre distance $r$")


def _in_words(single: bool, pair: Dataset) -> str:
    """Return the number of runs or, of several pairs, g at contact; and the width of the bins."""
    width = _bins_pooled(pair) * _bin_width(pair)
    if single:
        return f"{int(pair.runs):,} runs, 95 % band, bins of {width:.3g}"
    return f"g(contact) = {estimate_of(pair, 'contact_value')}, bins of {width:.3g}"


def _theory(axes: Axes, pairs: list[Dataset], named: bool) -> None:
    """Draw the contact value of theory and, for dilute equal disks, g(r) to first order in the
    density.
    """
    known = [pair for pair in pairs if has(pair, "contact_theory")]
    for k, pair in enumerate(known):
        hidden = "" if named and k == 0 else "_"
        contact = float(pair.contact_distance)
        value = float(pair.contact_theory)
        label = f"{hidden}theory at contact"
        if len(known) == 1:
            label += f": {value:.4g}"
        axes.plot(
            [contact], [value], "_", color=style.INK, markersize=12, linestyle="", label=label
        )
        if has(pair, "compressibility_rate") and pair.packing_fraction < DILUTE:  # equal disks
            r = np.linspace(contact, float(pair.distance[-1]), 400)
            g = theory.dilute_pair_distribution(r, r[0], float(pair.packing_fraction))
            label = f"{hidden}first order in the density"
            axes.plot(r, g, color=style.INK, linestyle=style.DASHED, linewidth=1, label=label)


def _bin_width(pair: Dataset) -> float:
    """Return the width [length] of the bins of g(r) in the dataset."""
    return float(pair.distance[1] - pair.distance[0])


def _bins_pooled(pair: Dataset) -> int:
    """Return how many neighbouring bins are pooled: as many as LARGEST_ERROR asks for, but at most
    MOST_POOLED.

    Errors of bins are taken as independent: the error of their mean falls as the root of their
    number.
    """
    g = pair[NAME]
    error = pair[f"{NAME}_standard_error"]
    relative = float((error / g.where(g > 0)).median())
    if not relative > LARGEST_ERROR:
        return 1
    return min(int(np.ceil((relative / LARGEST_ERROR) ** 2)), MOST_POOLED)


def _sums(values: DataArray, number: int) -> DataArray:
    """Return the sums of values over `number` neighbouring bins each."""
    return values.coarsen(distance=number, boundary="trim").sum()


def _pooled(pair: Dataset, number: int) -> Dataset:
    """Return g(r) with `number` neighbouring bins in one, weighted by the area of their rings."""
    if number == 1:
        return pair
    area = pair.distance.rename("area")
    error = area * pair[f"{NAME}_standard_error"]
    total = _sums(area * pair[NAME], number)
    variance = _sums(error**2, number)
    areas = _sums(area, number)
    mean = total / areas
    reach = NORMAL * np.sqrt(variance) / areas
    return Dataset({NAME: mean, f"{NAME}_low": mean - reach, f"{NAME}_high": mean + reach})


FIGURE = Figure(
    curves=draw_pair_distributions,
    labels=("pair distribution function $g(r)$",),
    variables=(NAME,),
    component="species_pair",
    table=Columns(("species_pair", "distance"), (NAME,)),
)
