"""Figure `pair_distribution`: g(r) of every pair of species, and its value at contact by two routes."""

import numpy as np

from brownpipe.figures.cases import defined, has, plus_minus, title_of
from brownpipe.figures.style import DATA, DOTTED, FILL, FIT, FREE, START, band, bars, columns, heads
from brownpipe.figures.tables import long_table

NAME = "pair_distribution"
CONTACTS = {
    "contact_value": ("at contact, from $g(r)$", FIT, "o", -1),
    "contact_value_rate": ("at contact, from the collision rate", FREE, "s", 1),
}  # label, colour, marker, on which side of contact
SURE = 0.02  # relative error of a bin that is drawn: neighbours are pooled until theirs is not larger,
FINE = 0.25  # up to this width, in contact distances
VARIABLES = (NAME,)
LACKING = "the observable pair_distribution was not asked for, or no two disks come near"


def draw(cases):
    """One panel per case and pair of species: g(r) with its 95 % band, 1, and the values at contact.

    Cases with equally many pairs have a column each; else all panels follow each other.
    """
    stacks = [[(case, pair) for pair in case.species_pair.values if has(_of(case, pair), NAME)] for case in cases]
    if len(set(map(len, stacks))) > 1:
        stacks = [[panel] for stack in stacks for panel in stack]
    rows = list(zip(*stacks, strict=True))
    figure, axes = columns(["pair distribution $g(r)$"] * len(rows), len(stacks), [3.6] * len(rows), sharey=False)
    for panels, row in zip(axes, rows, strict=True):
        for panel, (case, pair) in zip(panels, row, strict=True):
            _panel(panel, defined(_of(case, pair), NAME, "distance"))
        heads(panels, [f"{title_of(case)}: {pair}" for case, pair in row])
    for panel in axes[-1]:
        panel.set_xlabel("distance $r$ of the centres")
    return figure


def _of(case, pair):
    return case.sel(species_pair=pair)


def _panel(axes, case):
    contact = float(case.contact_distance)
    case = case.isel(distance=case.distance.values > contact)
    r = case.distance.values
    axes.axvline(contact, color=START, linestyle=DOTTED, linewidth=1)
    axes.axhline(1, color=START, linewidth=0.8)
    _curve(axes, case, contact)
    for name in (name for name in CONTACTS if has(case, name)):
        label, colour, marker, side = CONTACTS[name]
        value = plus_minus(case[name], case[f"{name}_standard_error"])
        at = contact + side * 0.01 * (r[-1] - contact)
        axes.errorbar(
            at, case[name], bars([case], name), fmt=marker, color=colour, markersize=5, label=f"{label}: {value}"
        )
    axes.set_xlim(contact - 0.04 * (r[-1] - contact), r[-1])


def _curve(axes, case, contact):
    """g(r) with its band: of the bins or, where their errors are large, of several neighbours as steps."""
    label, several = f"{int(case.runs):,} runs, 95 % band", _together(case, contact)
    if several == 1:
        band(axes, case.distance.values, case, NAME, DATA, label=label)
        return
    edges, value, down, up = _pooled(case, several)
    axes.stairs(value + up, edges, baseline=value - down, fill=True, color=DATA, alpha=FILL, linewidth=0)
    label += f", bins of {several * _width(case):.2g}"
    axes.stairs(value, edges, baseline=None, color=DATA, linewidth=1.8, label=label)


def _width(case):
    return float(np.diff(case.distance.values[:2])[0])


def _together(case, contact):
    """How many bins are pooled."""
    if f"{NAME}_standard_error" not in case or case.sizes["distance"] < 2:
        return 1
    filled = case.isel(distance=case[NAME].values > 0)
    error = float((filled[f"{NAME}_standard_error"] / filled[NAME]).median())
    if not error > SURE:
        return 1
    return max(1, min(int(np.ceil((error / SURE) ** 2)), int(FINE * contact / _width(case))))


def _pooled(case, several):
    """Edges (B + 1,) of the pooled bins; their g and how far its interval reaches down and up (B,).

    Bins weigh as the area of their ring; their errors are taken to be independent, as counts of rare pairs are.
    """
    r, g = case.distance.values, case[NAME].values
    first = np.arange(0, r.size, several)
    total = np.add.reduceat(r, first)
    reach = [np.abs(case[f"{NAME}_{end}"].values - g) for end in ("low", "high")]
    errors = [np.sqrt(np.add.reduceat((r * each) ** 2, first)) / total for each in reach]
    edges = np.append(r[first], r[-1] + _width(case)) - _width(case) / 2
    return edges, np.add.reduceat(r * g, first) / total, *errors


def table(cases):
    """One row per case, pair of species and distance."""
    return long_table(cases, ("species_pair", "distance"), [NAME])
