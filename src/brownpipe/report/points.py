"""The values behind the marks of a figure, with their places in its SVG: what a page shows under the pointer.

They are read from the figure that was drawn, so that they cannot disagree with it.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from brownpipe.figures.style import STATED_X
from brownpipe.quoting import printable

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.container import Container
    from matplotlib.figure import Figure

MOST_POINTS = 800  # of a figure
DIGITS = 6  # of a value
SVG_DPI = 72  # user units of an SVG per inch
EDGE = 1e-6  # points this close to an axis are inside, in units of its length
HALF_INTERVAL = 2  # vertices of a segment from the low to the high end of an interval
LONGEST_TITLE = 80  # characters; longer ones are explanations
NUMBER = re.compile(r"[-0-9.e]*")  # as a tick shows it, or no text
OF_MATPLOTLIB = re.compile(r"_(child|container)\d+|_nolegend_|")  # labels
SIGNS = {
    "\\langle": "\u27e8",
    "\\rangle": "\u27e9",
    "\\phi": "\u03c6",
    "\\chi": "\u03c7",
    "\\gamma": "\u03b3",
    "\\zeta": "\u03b6",
    "\\cdot": "\u00b7",
    "\\times": "\u00d7",
    "\\,": "",
    "\\ ": " ",
}
RAISED = str.maketrans("0123456789-", "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079\u207b")
LOWERED = str.maketrans("0123456789", "\u2080\u2081\u2082\u2083\u2084\u2085\u2086\u2087\u2088\u2089")


class Marks(NamedTuple):
    """The points of one artist in data coordinates."""

    label: str  # "" for none
    colour: str
    x: np.ndarray  # (P,) where they are drawn
    y: np.ndarray  # (P,)
    stated_x: np.ndarray  # (P,) values of x on the page; they differ from `x` where markers are shifted side by side
    is_measured: bool  # drawn with markers: measured values, which are on the page even without a label


Intervals = dict[tuple[str, float], list[tuple[float, float]]]  # low and high ends at each colour and x


def points_of(figure: Figure) -> dict[str, Any]:
    """Return the points of a figure that has been drawn, as JSON.

    `size` is width and height of the SVG in its user units. Each of the `panels` has a title, the labels `x` and `y` of
    its axes and its `series`: a name, and `points` of place in the SVG (2), x, y and, if it has one, the ends of its
    95 % interval. A figure of more than MOST_POINTS points has every second, third, ... of the longest series.
    """
    width, height = (float(side * SVG_DPI) for side in figure.get_size_inches())
    panels = [_panel(axes, height) for axes in figure.axes if axes.get_visible()]
    panels = [panel for panel in panels if panel["series"]]
    series = [line for panel in panels for line in panel["series"]]
    most = _share([len(line["points"]) for line in series])
    for line in series:
        line["points"] = line["points"][:: -(-len(line["points"]) // most)]
    return {"size": [round(width, 2), round(height, 2)], "panels": panels}


def _share(lengths: list[int]) -> int:
    """Return to how many points series must be limited so that all together have at most MOST_POINTS."""
    most = max(lengths, default=1)
    while most > 1 and sum(min(length, most) for length in lengths) > MOST_POINTS:
        most -= 1
    return most


def _panel(axes: Axes, height: float) -> dict[str, Any]:
    marks = list(_marks(axes))
    labelled = {line.colour for line in marks if line.label}
    intervals = _intervals(axes)
    series = []
    for line in marks:
        if line.label or line.is_measured or line.colour not in labelled:
            name = line.label or _name_by_colour(axes, line.colour)
            points = list(_points(axes, height, line, intervals))
            series += [{"name": plain(name), "points": points}] if points and (name or line.is_measured) else []
    labels = {"title": _title(axes), "x": _label(axes, "x"), "y": _label(axes, "y")}
    return {name: plain(text) for name, text in labels.items()} | {"series": series}


def _points(axes: Axes, height: float, line: Marks, intervals: Intervals) -> Iterator[list]:
    """Yield place, values and interval of the points of an artist that are inside its axes; `height` is the SVG's."""
    finite = np.isfinite(line.x) & np.isfinite(line.y)
    places = np.stack([np.where(finite, line.x, 1.0), np.where(finite, line.y, 1.0)], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):  # zero has no place on a logarithmic axis
        places = axes.transData.transform(places)
        inside = np.all(np.abs(axes.transAxes.inverted().transform(places) - 0.5) <= 0.5 + EDGE, axis=1)
    places *= SVG_DPI / axes.figure.dpi
    for k in np.flatnonzero(finite & inside):
        x, y = float(line.x[k]), float(line.y[k])
        place = [round(float(places[k, 0]), 1), round(float(height - places[k, 1]), 1)]
        ends = intervals.get((line.colour, x), [])
        interval = next(([_short(low), _short(high)] for low, high in ends if low <= y <= high and low < high), [])
        yield [*place, _value(axes.xaxis, float(line.stated_x[k])), _value(axes.yaxis, y), *interval]


def _short(value: float) -> float:
    """Return a number of few digits; whole numbers without a point."""
    value = float(f"{value:.{DIGITS}g}")
    return int(value) if value.is_integer() and abs(value) < 10**DIGITS else value


def _value(axis: Axis, value: float) -> float | str:
    """Return a value as a number, or the word with which a tick of the axis names it."""
    from matplotlib.ticker import FixedFormatter, FuncFormatter

    formatter = axis.get_major_formatter()
    if isinstance(formatter, FixedFormatter | FuncFormatter) and axis.get_scale() == "linear":
        places = axis.get_majorticklocs()
        words = dict(zip(places.tolist(), formatter.format_ticks(places.tolist()), strict=False))
        if not NUMBER.fullmatch(words.get(value, "")):
            return plain(words[value])
    return _short(value)


# -- artists --------------------------------------------------------------------------------------------------------


def _marks(axes: Axes) -> Iterator[Marks]:
    """Yield lines, markers, error bars and steps that are drawn in data coordinates."""
    from matplotlib.container import ErrorbarContainer
    from matplotlib.patches import StepPatch

    bars = [bar for bar in axes.containers if isinstance(bar, ErrorbarContainer)]
    of_line = {id(bar[0]): bar for bar in bars if bar[0] is not None}
    for line in axes.lines:
        if all(line.get_transform().contains_branch_seperately(axes.transData)):
            bar = of_line.get(id(line), line)
            x, y = np.array(line.get_xdata(), float), np.array(line.get_ydata(), float)
            stated = np.array(getattr(bar, STATED_X, x), float)
            yield Marks(_own_label(bar), _colour(line.get_color()), x, y, stated, line.get_marker() not in ("", "None"))
    for patch in axes.patches:
        if isinstance(patch, StepPatch) and not patch.get_fill():
            values, edges, _ = patch.get_data()
            x = (edges[1:] + edges[:-1]) / 2
            yield Marks(_own_label(patch), _colour(patch.get_edgecolor()), x, np.asarray(values, float), x, False)


def _intervals(axes: Axes) -> Intervals:
    """Return the ends of bands, error bars and filled steps."""
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.patches import StepPatch

    found: Intervals = defaultdict(list)
    for collection in axes.collections:
        if isinstance(collection, PolyCollection):
            colour = _colour(collection.get_facecolor()[0]) if len(collection.get_facecolor()) else ""
            for path in collection.get_paths():  # a polygon around a band
                heights = defaultdict(list)
                for x, y in np.asarray(path.vertices).tolist():
                    heights[x].append(y)
                for x, ends in heights.items():
                    found[colour, x].append(_ends(ends))
        elif isinstance(collection, LineCollection):
            colour = _colour(collection.get_color()[0])
            for segment in collection.get_segments():
                if len(segment) == HALF_INTERVAL and segment[0][0] == segment[1][0]:
                    found[colour, float(segment[0][0])].append(_ends(segment[:, 1]))
    for patch in axes.patches:
        if isinstance(patch, StepPatch) and patch.get_fill():
            values, edges, baseline = patch.get_data()
            centres = (edges[1:] + edges[:-1]) / 2
            for x, *ends in np.stack([centres, values, np.broadcast_to(baseline, np.shape(values))], axis=1):
                found[_colour(patch.get_facecolor()), float(x)].append(_ends(ends))
    return found


def _ends(values: Iterable[float]) -> tuple[float, float]:
    return float(np.min([*values])), float(np.max([*values]))


def _colour(colour: Any) -> str:
    """Return a colour without its opacity, by which a line and its band differ."""
    from matplotlib.colors import to_hex

    return to_hex(colour, keep_alpha=False)


def _own_label(artist: Artist | Container) -> str:
    """Return the label of an artist without the mark that keeps it out of legends, "" if it has none of its own."""
    label = str(artist.get_label() or "")
    return "" if OF_MATPLOTLIB.fullmatch(label) else label.removeprefix("_")


# -- words ----------------------------------------------------------------------------------------------------------


def _column(axes: Axes) -> list[Axes]:
    """Return the panels in the same column of a figure, from the top down."""
    left = axes.get_position().x0
    panels = [panel for panel in axes.figure.axes if abs(panel.get_position().x0 - left) < EDGE]
    return sorted(panels, key=lambda panel: -panel.get_position().y0)


def _name_by_colour(axes: Axes, colour: str) -> str:
    """Return the label of an artist of this colour in the panel itself or in one above it; "" if there is none."""
    panels = _column(axes)
    lines = (line for panel in reversed(panels[: panels.index(axes) + 1]) for line in _marks(panel))
    return next((line.label for line in lines if line.label and line.colour == colour), "")


def _title(axes: Axes) -> str:
    """Return the title of a panel, or else of the one above it."""
    panels = _column(axes)
    titles = [panel.get_title(loc="left") for panel in panels[: panels.index(axes) + 1]]
    return next((title for title in reversed(titles) if 0 < len(title) <= LONGEST_TITLE), "")


def _label(axes: Axes, name: str) -> str:
    """Return the label of an axis of a panel, or of the panel beside or below that shows it for both."""
    if name == "x":
        panels = _column(axes)
        labels = [panel.get_xlabel() for panel in panels[panels.index(axes) :]]
    else:
        bottom = axes.get_position().y0
        beside = [panel for panel in axes.figure.axes if abs(panel.get_position().y0 - bottom) < EDGE]
        labels = [axes.get_ylabel(), *(panel.get_ylabel() for panel in beside)]
    return next(filter(None, labels), "")


def plain(text: str) -> str:
    """Return a label of matplotlib without the marks of its formulae, in one line; other words stay as they are."""
    text = re.sub(r"\$([^$]*)\$", lambda found: _formula(found[1]), text)
    return printable(" ".join(text.split())).replace("\u27e8 ", "\u27e8").replace(" \u27e9", "\u27e9")


def _formula(text: str) -> str:
    """Return a formula of matplotlib in plain characters."""
    for sign, character in SIGNS.items():
        text = text.replace(sign, character)
    text = re.sub(r"\\sqrt\{([^}]*)\}", "\u221a(\\1)", text)
    text = re.sub(r"\^(\d)|\^\{(-?\d+)\}", lambda found: (found[1] or found[2]).translate(RAISED), text)
    text = re.sub(r"_(\d)", lambda found: found[1].translate(LOWERED), text)
    return re.sub(r"[{}\\]", "", text)
