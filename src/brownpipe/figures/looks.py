"""How lines look: by the properties that `matplotlib.lines.Line2D` has."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypedDict

if TYPE_CHECKING:
    from matplotlib.typing import (
        ColorType,
        DrawStyleType,
        FillStyleType,
        LineStyleType,
        MarkerType,
        MarkEveryType,
    )


class Looks(TypedDict, total=False):
    """Properties of a line by their long or short names, as for `axes.plot`."""

    color: ColorType
    c: ColorType
    linestyle: LineStyleType
    ls: LineStyleType
    linewidth: float
    lw: float
    drawstyle: DrawStyleType
    ds: DrawStyleType
    marker: MarkerType
    markersize: float
    ms: float
    markevery: MarkEveryType
    markeredgecolor: ColorType
    mec: ColorType
    markeredgewidth: float
    mew: float
    markerfacecolor: ColorType
    mfc: ColorType
    fillstyle: FillStyleType
    alpha: float
    antialiased: bool
    aa: bool
    clip_on: bool
    rasterized: bool
    visible: bool
    zorder: float
    label: str


NO_LOOKS: Looks = {}


def replaced(own: Looks, looks: Looks) -> Looks:
    """Return the looks of a line with those that are to replace its own, by any of their names.

    >>> replaced({"color": "black", "label": "exact"}, {"c": "red"})
    {'color': 'red', 'label': 'exact'}
    """
    from matplotlib.cbook import normalize_kwargs
    from matplotlib.lines import Line2D

    replacing: Any = normalize_kwargs({**looks}, Line2D)  # by their long names
    return {**own, **replacing}
