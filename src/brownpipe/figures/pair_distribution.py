"""Figure `pair_distribution`: g(r) of every pair of species, and its value at contact by two routes.

The routes: extrapolation of g(r) to contact, and the collision rate of the pair (docs/theory.md).
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pandas import DataFrame
from xarray import Dataset

from brownpipe.figures.cases import defined, has, parts_of, plus_minus, title_of
from brownpipe.figures.style import DATA, DOTTED, FILL, FIT, GREY, MODEL, band, columns, heads, points
from brownpipe.figures.tables import frame_of

NAME = "pair_distribution"
CONTACTS = {
    "contact_value": ("at contact, by extrapolation", FIT, "o"),
    "contact_value_rate": ("at contact, from the collision rate", MODEL, "s"),
}  # label, colour, marker
LARGEST_ERROR = 0.02  # relative error of g(r) above which neighbouring bins are pooled
WIDEST = 0.25  # width of a pooled bin, in contact distances


def draw(cases: list[Dataset]) -> Figure:
    """Draw one panel per case and pair of species: g(r) with its 95 % band, and its values at contact."""
    parts = [part for case in cases for part in parts_of(case, "species_pair", NAME)]
    figure, (panels,) = columns(["pair distribution function $g(r)$"], len(parts), [3.6], sharey=False)
    for panel, part in zip(panels, parts, strict=True):
        _panel(panel, defined(part, NAME, "distance"))
        panel.set_xlabel("centre-to-centre distance $r$")
    heads(panels, [f"{title_of(part)}: {part.species_pair.item()}" for part in parts])
    return figure


def _panel(axes: Axes, case: Dataset) -> None:
    """Draw g(r) beyond the contact distance, the contact distance, and the values there."""
    contact = float(case.contact_distance)
    case = case.isel(distance=case.distance.values > contact)
    r = case.distance.values
    axes.axvline(contact, color=GREY, linestyle=DOTTED, linewidth=1)
    axes.axhline(1, color=GREY, linewidth=0.8)
    _curve(axes, case, contact)
    for name in (name for name in CONTACTS if has(case, name)):
        label, colour, marker = CONTACTS[name]
        value = plus_minus(case[name], case[f"{name}_standard_error"])
        points(axes, [contact], [case], name, fmt=marker, color=colour, label=f"{label}: {value}")
    axes.set_xlim(contact - 0.04 * (r[-1] - contact), r[-1])


def _curve(axes: Axes, case: Dataset, contact: float) -> None:
    """Draw g(r) with its band: a curve or, if the errors of single bins are large, steps of several pooled bins."""
    label = f"{int(case.runs):,} runs, 95 % band"
    pooled_bins = _bins_to_pool(case, contact)
    if pooled_bins == 1:
        band(axes, case, NAME, DATA, label=label)
        return
    edges, value, down, up = _pooled(case, pooled_bins)
    axes.stairs(value + up, edges, baseline=value - down, fill=True, color=DATA, alpha=FILL, linewidth=0)
    label += f", bins of width {pooled_bins * _width(case):.2g}"
    axes.stairs(value, edges, baseline=None, color=DATA, linewidth=1.8, label=label)


def _width(case: Dataset) -> float:
    """Width of the bins [length]."""
    return float(np.diff(case.distance.values[:2])[0])


def _bins_to_pool(case: Dataset, contact: float) -> int:
    """How many neighbouring bins to pool: the error of independent counts falls as one over the root of the number."""
    filled = case.isel(distance=case[NAME].values > 0)
    error = float((filled[f"{NAME}_standard_error"] / filled[NAME]).median())
    if case.sizes["distance"] < 2 or not error > LARGEST_ERROR:
        return 1
    return max(1, min(int(np.ceil((error / LARGEST_ERROR) ** 2)), int(WIDEST * contact / _width(case))))


def _pooled(case: Dataset, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pool bins in groups: edges (B + 1,), g (B,), and how far its 95 % interval reaches down and up (B,).

    Bins are weighted by the area of their ring. Their errors are taken as independent, as for counts of rare pairs.
    """
    r = case.distance.values
    g = case[NAME].values
    first = np.arange(0, r.size, number)
    total = np.add.reduceat(r, first)
    reach = [np.abs(case[f"{NAME}_{end}"].values - g) for end in ("low", "high")]
    down, up = (np.sqrt(np.add.reduceat((r * error) ** 2, first)) / total for error in reach)
    edges = np.append(r[first], r[-1] + _width(case)) - _width(case) / 2
    return edges, np.add.reduceat(r * g, first) / total, down, up


def table(cases: list[Dataset]) -> DataFrame:
    """Return one row per case, pair of species and distance."""
    return frame_of(cases, ("species_pair", "distance"), [NAME])
