"""Figure `pair_distribution`: g(r) of every pair of species, and its value at contact by two routes.

The routes: extrapolation of g(r) to contact, and the collision rate of the pair (docs/theory.md).
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from xarray import DataArray, Dataset

from brownpipe import theory
from brownpipe.analysis.pairs import NORMAL
from brownpipe.figures import style
from brownpipe.figures.cases import estimate_of, has

NAME = "pair_distribution"
LABELS = ("pair distribution function $g(r)$",)
TABLE = (("species_pair", "distance"), (NAME,))
CONTACTS = {
    "contact_value": ("at contact, by extrapolation", style.FIT, "o"),
    "contact_value_rate": ("at contact, from the collision rate", style.MODEL, "s"),
}  # label, colour, marker
LARGEST_ERROR = 0.02  # relative error of g(r) above which neighbouring bins are pooled
WIDEST = 0.25  # width of a pooled bin, in contact distances
DILUTE = 0.2  # packing fraction below which the first order in the density is drawn


def curves(axes: Axes, pairs: list[Dataset], **looks: Any) -> None:
    """Draw g(r) of each pair of species with its 95 % band, and theory.

    Of several pairs or with `looks` it is drawn with its value at contact, of a single one with both values.
    """
    pairs = [_beyond_contact(pair) for pair in pairs]
    contacts = [float(pair.contact_distance) for pair in pairs]
    axes.axhline(1, color=style.GREY, linewidth=0.8)
    for contact in {*contacts}:
        axes.axvline(contact, color=style.GREY, linestyle=style.DOTTED, linewidth=1)
    single = len(pairs) == 1 and not looks
    for pair, line in style.told_apart(pairs, _runs_in_words if single else _contact_in_words, looks):
        _curve(axes, pair, **line)
        for name in (name for name in CONTACTS if has(pair, name)):
            words, colour, marker = CONTACTS[name]
            label = f"{words}: {estimate_of(pair, name)}" if single else "_"
            look = {"color": colour if single else line["color"], "fmt": marker, "label": label}
            style.points(axes, [float(pair.contact_distance)], [pair], name, **look)
    _theory(axes, pairs, named=not looks)
    end = max(float(pair.distance[-1]) for pair in pairs)
    axes.set_xlim(min(contacts) - 0.04 * (end - min(contacts)), end)
    axes.set_xlabel("centre-to-centre distance $r$")


def _beyond_contact(pair: Dataset) -> Dataset:
    return pair.isel(distance=pair.distance.values > float(pair.contact_distance))


def _runs_in_words(pair: Dataset) -> str:
    return f"{int(pair.runs):,} runs, 95 % band"


def _contact_in_words(pair: Dataset) -> str:
    return f"g(contact) = {estimate_of(pair, 'contact_value')}"


def _theory(axes: Axes, pairs: list[Dataset], named: bool) -> None:
    """Draw the contact value of theory and, for dilute equal disks, g(r) to first order in the density."""
    known = [pair for pair in pairs if has(pair, "contact_theory")]
    for k, pair in enumerate(known):
        label = f"theory at contact: {float(pair.contact_theory):.4g}" if len(known) == 1 else "theory at contact"
        place = [float(pair.contact_distance)], [float(pair.contact_theory)]
        axes.plot(*place, "_", color=style.INK, markersize=12, linestyle="", label="_" * (k > 0 or not named) + label)
    dilute = [pair for pair in known if has(pair, "compressibility_rate") and pair.packing_fraction < DILUTE]
    for k, pair in enumerate(dilute):  # of equal disks
        sigma, label = float(pair.contact_distance), "_" * (k > 0 or not named) + "first order in the density"
        r = np.linspace(sigma, float(pair.distance[-1]), 400)
        g = theory.dilute_pair_distribution(r, sigma, float(pair.packing_fraction))
        axes.plot(r, g, color=style.INK, linestyle=style.DASHED, linewidth=1, label=label)


def _curve(axes: Axes, pair: Dataset, label: str, **looks: Any) -> None:
    """Draw g(r) with its band; where the errors of single bins are large, of several pooled bins."""
    filled = pair.isel(distance=pair[NAME].values > 0)
    error = float((filled[f"{NAME}_standard_error"] / filled[NAME]).median())  # falls as the root of the number of bins
    if error > LARGEST_ERROR:
        width = float(np.diff(pair.distance.values[:2])[0])
        number = min(int(np.ceil((error / LARGEST_ERROR) ** 2)), max(1, int(WIDEST * pair.contact_distance / width)))
        pair, label = _pooled(pair, number), f"{label}, bins of width {number * width:.2g}"
    style.band(axes, pair, NAME, label=label, **looks)


def _pooled(pair: Dataset, number: int) -> Dataset:
    """Return g(r) in bins so many times as wide, weighted by the area of their rings, errors taken as independent."""

    def total(values: DataArray) -> DataArray:
        return values.coarsen(distance=number, boundary="trim").sum()

    ring = pair.distance.rename("area")
    mean = total(ring * pair[NAME]) / total(ring)
    reach = NORMAL * np.sqrt(total((ring * pair[f"{NAME}_standard_error"]) ** 2)) / total(ring)
    return Dataset({NAME: mean, f"{NAME}_low": mean - reach, f"{NAME}_high": mean + reach})
