"""Figure `pair_distribution`: g(r) of every pair of species, and its value at contact by two routes."""

from brownpipe.figures.cases import defined, has, plus_minus, title_of
from brownpipe.figures.style import DATA, DOTTED, FIT, FREE, START, band, bars, grid, head
from brownpipe.figures.tables import long_table

NAME = "pair_distribution"
CONTACTS = {
    "contact_value": ("at contact, from $g(r)$", FIT, "o", -1),
    "contact_value_rate": ("at contact, from the collision rate", FREE, "s", 1),
}  # label, colour, marker, on which side of contact
NEEDS = (NAME,)
LACKING = "the observable pair_distribution was not asked for, or no two disks come near"


def draw(cases):
    """One column per case, one row per pair of species: g(r) with its 95 % band, 1, and the values at contact."""
    pairs = [pair for pair in cases[0].species_pair.values if any(has(_of(case, pair), NAME) for case in cases)]
    figure, axes = grid(len(pairs), len(cases), 4.8, 3.6)
    for row, pair in zip(axes, pairs, strict=True):
        for panel, case in zip(row, cases, strict=True):
            if has(_of(case, pair), NAME):
                _panel(panel, defined(_of(case, pair), NAME, "distance"), f"{title_of(case)}: {pair}")
            else:
                panel.set_axis_off()
        row[0].set_ylabel("pair distribution $g(r)$")
    for panel in axes[-1]:
        panel.set_xlabel("distance $r$ of the centres (reduced units)")
    return figure


def _of(case, pair):
    return case.sel(species_pair=pair)


def _panel(axes, case, title):
    contact = float(case.contact_distance)
    case = case.isel(distance=case.distance.values > contact)
    r = case.distance.values
    axes.axvline(contact, color=START, linestyle=DOTTED, linewidth=1)
    axes.axhline(1, color=START, linewidth=0.8)
    band(axes, r, case, NAME, DATA, label=f"{int(case.runs):,} runs, 95 % band")
    for name in (name for name in CONTACTS if has(case, name)):
        label, colour, marker, side = CONTACTS[name]
        value = plus_minus(case[name], case[f"{name}_standard_error"])
        at = contact + side * 0.01 * (r[-1] - contact)
        axes.errorbar(
            at, case[name], bars([case], name), fmt=marker, color=colour, markersize=5, label=f"{label}: {value}"
        )
    axes.set_xlim(contact - 0.04 * (r[-1] - contact), r[-1])
    head(axes, title)


def table(cases):
    """One row per case, pair of species and distance."""
    return long_table(cases, ("species_pair", "distance"), [NAME])
