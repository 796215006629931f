"""Figure `orientational_order`: the bond-orientational order abs(psi_6) of all disks against what
is varied.
"""

from itertools import cycle
from typing import Unpack

from matplotlib.axes import Axes
from xarray import Dataset

from brownpipe.figures.cases import axis_label, axis_of, series_of
from brownpipe.figures.figure import Columns, Figure
from brownpipe.figures.looks import Looks, replaced
from brownpipe.figures.style import MARKS, points

NAME = "orientational_order"


def draw_order(axes: Axes, cases: list[Dataset], **looks: Unpack[Looks]) -> None:
    """Draw a point per case against a varied key, the packing fraction or the number of disks, by
    what else differs.
    """
    densities = {float(case.packing_fraction) for case in cases}
    axis = axis_of(cases, "packing_fraction" if len(densities) > 1 else "particles")
    if axis == "packing_fraction":
        series = series_of(cases, axis, "particles")
    else:
        series = series_of(cases, axis)
    for (label, series_cases), mark in zip(series.items(), cycle(MARKS), strict=False):
        places = [case[axis].item() for case in series_cases]
        own: Looks = {**mark, "label": label}
        points(axes, places, series_cases, NAME, **replaced(own, looks))
    axes.set_ylim(bottom=0)
    axes.set_xlabel(axis_label(cases[0], axis))


FIGURE = Figure(
    curves=draw_order,
    labels=("bond-orientational order $|\\psi_6|$",),
    variables=(NAME,),
    every_count=True,
    table=Columns((), ("packing_fraction", NAME, f"{NAME}_squared")),
)
