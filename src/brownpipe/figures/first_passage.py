"""Figure `first_passage`: the probability that the tracer has not left the circle of its radius
around its start, against time.
"""

from typing import Unpack

import numpy as np
from matplotlib.axes import Axes
from xarray import Dataset

from brownpipe.figures.cases import estimate_of
from brownpipe.figures.figure import Columns, Figure
from brownpipe.figures.looks import Looks
from brownpipe.figures.style import DOTTED, GREY, band, styled_cases, time_axis

SURVIVAL = "first_passage_survival"
MEDIAN = "first_passage_median"  # which has an interval and no standard error


def draw_survival(axes: Axes, cases: list[Dataset], **looks: Unpack[Looks]) -> None:
    """Draw the probability of each case with its 95 % band, and across the line at 1/2 the interval
    of the median.
    """
    axes.axhline(0.5, color=GREY, linestyle=DOTTED, linewidth=1)
    for case, line in styled_cases(cases, _passage_in_words, looks):
        band(axes, case, SURVIVAL, **line)
        interval = [float(case[f"{MEDIAN}{end}"]) for end in ("_low", "_high")]
        axes.plot(interval, [0.5, 0.5], color=line["color"], linewidth=1.2, marker="|")
    time_axis(axes, cases)
    axes.set_ylim(0, 1.02)


def _passage_in_words(case: Dataset) -> str:
    """Return the median with its 95 % interval, and the share of the runs that end before the
    tracer leaves.
    """
    inside = float(case[SURVIVAL][-1])
    censored = f"inside at the end {inside:.1%}" if inside else "all leave"
    if np.isnan(case[MEDIAN]):
        return f"median after the end; {censored}"
    return f"median {estimate_of(case, MEDIAN)}; {censored}"


FIGURE = Figure(
    curves=draw_survival,
    labels=("share $S(t)$ still inside",),
    variables=(SURVIVAL,),
    table=Columns(("time",), (SURVIVAL,)),
)
